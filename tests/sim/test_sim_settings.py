import pytest

from server.sim import SimSettings, sim_settings


def test_a_bare_link_is_the_default_board() -> None:
    assert sim_settings("sim:") == SimSettings()


def test_every_option_of_the_link_reaches_its_setting() -> None:
    url = "sim:?seed=3&speed=2&wind=0&outage=60:85&rate_hz=500&noise=0.5&rtk=1"
    assert sim_settings(url) == SimSettings(
        seed=3, speed=2.0, wind_m_s=0.0, outages_s=((60.0, 85.0),), rate_hz=500.0, noise=0.5, rtk=True
    )


def test_outages_may_be_repeated_or_listed_and_come_sorted() -> None:
    assert sim_settings("sim:?outage=90:95,10:12.5&outage=60:85").outages_s == (
        (10.0, 12.5),
        (60.0, 85.0),
        (90.0, 95.0),
    )


def test_an_interval_is_rounded_down_to_whole_milliseconds_as_boards_do() -> None:
    assert [SimSettings(rate_hz=hz).shortest_interval_ms for hz in (333.0, 1000.0, 400.0, 50.0)] == [3, 1, 2, 20]


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("serial:///dev/ttyACM0", "not a demo board"),
        ("sim://there", "not a demo board"),
        ("sim:?sed=3", r"'sed' is unknown; allowed are seed, .*outage"),
        ("sim:?seed=-1", "not a whole number"),
        ("sim:?seed=1.5", "not a whole number"),
        ("sim:?wind=storm", r"wind='storm' is not a number from 0 to 12"),
        ("sim:?wind=nan", "not a number from"),
        ("sim:?speed=0", r"from 0.1 to 20"),
        ("sim:?rate_hz=2000", r"from 1 to 1000 \(Hz\)"),
        ("sim:?wind=1&wind=2", "given twice"),
        ("sim:?noise=0", "from 0.01 to 10"),
        ("sim:?rtk=yes", "neither 0 nor 1"),
        ("sim:?outage=85:60", "not START:END"),
        ("sim:?outage=60", "not START:END"),
        ("sim:?outage=-5:60", "not START:END"),
        ("sim:?outage=5:inf", "not START:END"),
        ("sim:?seed", "not a whole number"),
    ],
)
def test_a_wrong_link_says_what_is_allowed(url: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        sim_settings(url)
