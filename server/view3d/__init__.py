"""The viser scene of every board behind our own port: `View3D` holds it, `router` serves it at /view/."""

from server.view3d.feed import BoardFeed
from server.view3d.proxy import router
from server.view3d.view import View3D

__all__ = ["BoardFeed", "View3D", "router"]
