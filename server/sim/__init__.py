"""The demo board behind the link `sim:`: a quadrotor that flies a fixed path for ever and speaks MAVLink 2."""

from server.sim.board import SimBoard
from server.sim.settings import SimSettings, sim_settings
from server.sim.stream import SimStream

__all__ = ["SimBoard", "SimSettings", "SimStream", "sim_settings"]
