"""What the API says of a filter whose innovations and errors are not as large as its σ."""

import math
from dataclasses import replace

from server.nav.types import Aid, AidHealth, ConsistencyHealth
from server.views import health_out
from tests.shell.test_shell_verdict import WELL, snapshot_of

AID = AidHealth(aid=Aid.GNSS_VELOCITY, fused=300, refused=(), t_fused_ns=1, last=())
WHOLE = ConsistencyHealth(
    lane="ins_ekf", group="lane", mean=1.7, low=0.9, high=1.1, samples=300, verdict="over-confident", reason="why"
)


def test_every_aid_has_its_mean_its_bound_and_its_verdict() -> None:
    aid = replace(AID, nis_mean=1.7, nis_low=0.9, nis_high=1.1, nis_samples=300, verdict="over-confident")
    (out,) = health_out(replace(WELL, snapshot=snapshot_of(aids=(aid,)))).aids
    assert (out.nis_low, out.nis_mean, out.nis_high, out.nis_samples) == (0.9, 1.7, 1.1, 300)
    assert out.verdict == "over-confident"


def test_before_there_is_a_verdict_its_numbers_are_null() -> None:
    (out,) = health_out(replace(WELL, snapshot=snapshot_of(aids=(AID,)))).aids
    assert (out.nis_mean, out.nis_low, out.nis_high, out.verdict) == (None, None, None, "too-few")


def test_the_main_lane_is_judged_group_by_group_and_as_a_whole() -> None:
    attitude = ConsistencyHealth(lane="ins_ekf", group="attitude", mean=math.nan, samples=3)
    out = health_out(replace(WELL, snapshot=snapshot_of(consistency=(attitude, WHOLE)))).consistency
    assert [(one.group, one.verdict, one.reason) for one in out] == [
        ("attitude", "too-few", ""),
        ("lane", "over-confident", "why"),
    ]
    assert out[0].mean is None


def test_without_an_engine_there_is_nothing_to_judge() -> None:
    assert health_out(replace(WELL, snapshot=None)).consistency == ()
