"""The report as a browser shows it: from disk, in both themes, curves hidden and shown by the legend."""

from pathlib import Path

import pytest

from server.view3d.palette import LANE_RGB
from tests.compare.test_report import report

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_report_opens_from_disk_in_both_themes_without_any_request(browser, tmp_path: Path, theme: str) -> None:
    place = tmp_path / "report.html"
    place.write_text(report().html(), encoding="utf-8")
    context = browser.new_context(color_scheme=theme, viewport={"width": 360, "height": 800})
    page, asked, said = context.new_page(), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(place.as_uri())
    assert asked == [place.as_uri()]
    assert said == []
    curve = page.locator('.curve[data-of="ins-ekf"] path').first
    colour = "rgb({}, {}, {})".format(*LANE_RGB[theme]["ins_ekf"])
    assert curve.evaluate("path => getComputedStyle(path).stroke") == colour
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    page.get_by_label("ins_ekf").uncheck()
    assert page.locator('.curve[data-of="ins-ekf"]').evaluate_all("all => all.every(e => e.style.display === 'none')")
    page.get_by_label("ins_ekf").check()
    assert curve.is_visible()
    context.close()
