"""Which of several estimates of the clocks a rig starts from."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from estimator.data.rigs.bundle import RigState
from estimator.data.rigs.search import RigStart, best_start


def start(cost: float, common: float) -> RigStart:
    return RigStart(cost, common, np.zeros(2), cast(RigState, None))


@pytest.mark.parametrize("scale", [1.0, 7.0])
def test_little_time_in_common_loses_unless_it_is_much_better(scale: float) -> None:
    much, little = start(1.0 * scale, 9.0), start(0.7 * scale, 0.8)
    assert best_start([little, much]) is much
    clear = replace(little, cost=0.3 * scale)
    assert best_start([much, clear]) is clear
    enough = replace(little, common=6.0)
    assert best_start([much, enough]) is enough
    assert best_start([much, replace(much, cost=2.0 * scale)]) is much
    assert best_start([]) is None
