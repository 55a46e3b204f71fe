"""Trials of the second plant as the series that `features` takes, and what is found in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.series import Series
from jbclog.analysis.verdict.idle import Block
from support.plants.joint_score import Score, score
from support.plants.second_plant import Trial


def series_of(trial: Trial, hz: float) -> Series:
    rows = Block(trial.seconds, trial.temperature, trial.power, trial.setting, trial.working)
    return Series(rows, ~np.isnan(trial.temperature), 1 / hz)


def found_in(trial: Trial, hz: float) -> list[tuple[float, float]]:
    return [(joint.start_s, joint.end_s) for joint in find_joints(series_of(trial, hz)).joints]


def scores(trials: Sequence[Trial], hz: float) -> list[Score]:
    return [score(trial, found_in(trial, hz)) for trial in trials]
