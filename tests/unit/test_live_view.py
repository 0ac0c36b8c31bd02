"""The live view: what it draws on, and when a run is over."""

import numpy as np

from services.viewer.live import LiveView
from shared.messaging.channels import MAP_STATUS, TF
from shared.messaging.messages import MapStatus, Transforms
from tests.support.examples import EXAMPLES

(STATUS,) = [example for example in EXAMPLES if isinstance(example, MapStatus)][:1]


def transforms(stamp_s):
    pose = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    stamp_ns = round(stamp_s * 1e9)
    return Transforms(
        stamp_ns=stamp_ns, seq=0, frame="world", parents=("world",), children=("hip",), T_parent_child=pose
    )


def test_what_is_said_is_drawn_and_nothing_answered():
    drawn = []
    assert LiveView(drawn.extend).show(MAP_STATUS, STATUS) == []
    assert "map/status/score" in {item.entity for item in drawn}


def test_it_knows_how_far_it_is():
    view = LiveView([].extend)
    assert view.newest_ns is None
    for stamp_s in (1.0, 2.0, 1.9):
        view.show(TF, transforms(stamp_s))
    assert (view.newest_ns, view.is_over) == (2_000_000_000, False)


def test_a_run_is_over_when_time_begins_anew():
    drawn = []
    view = LiveView(drawn.extend)
    for stamp_s in (5.0, 0.1):
        view.show(TF, transforms(stamp_s))
    view.show(MAP_STATUS, STATUS)
    assert view.is_over
    assert [item.entity for item in drawn] == ["tf"]
