"""Can a classifier tell the next action from the picture at the alias points?

If the hidden state is hidden, nothing learned from observations beats chance there.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from hide_tasks.contract import Observation
from hide_tasks.statistics import Rate

CELL = 8  # pixels of a feature's square
FOLDS = 5  # whole layouts are left out at a time
MARGIN = 0.10  # above chance that the upper end of the interval may be


class Sample(NamedTuple):
    """An observation at an alias point and what the expert does next."""

    layout: int
    group: int  # of the moments of a layout that look alike
    observation: Observation
    label: str


def features(observation: Observation) -> NDArray[np.float64]:
    """Colour and depth in 16 x 16 squares per camera, joints, pose, opening.

    Rounded to a tenth of the alias tolerance: a difference under it is no information.
    """
    parts = [
        observation.joint_positions.round(3),
        observation.gripper_pose.round(3),
        np.array([round(observation.gripper_opening, 2)]),
    ]
    for view in observation.views.values():
        parts.append(_squares(view.rgb.astype(np.float64) / 255).round(3))
        parts.append(_squares(view.depth[..., None].astype(np.float64)).round(3))
    return np.concatenate(parts)


def _squares(image: NDArray[np.float64]) -> NDArray[np.float64]:
    h, w, channels = image.shape
    blocks = image.reshape(h // CELL, CELL, w // CELL, CELL, channels)
    return np.asarray(blocks.mean(axis=(1, 3))).ravel()


def classifiers() -> dict[str, Pipeline]:
    """The probes by name."""
    return {
        "nearest": make_pipeline(StandardScaler(), KNeighborsClassifier(5)),
        "linear": make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=300)),
    }


def probe(samples: Sequence[Sample]) -> dict[str, Any]:
    """Accuracy of every classifier with its Wilson interval, beside chance.

    A classifier is told which labels the moments of a sample's group have, so that it has to tell
    these apart and nothing else. Without samples there is nothing to be told apart.
    """
    if not samples:
        return {"samples": 0, "chance": 1.0, "blind": False}
    x = np.array([features(sample.observation) for sample in samples])
    y = np.array([sample.label for sample in samples])
    layouts = np.array([sample.layout for sample in samples])
    groups: dict[tuple[int, int], set[str]] = defaultdict(set)
    for sample in samples:
        groups[sample.layout, sample.group].add(sample.label)
    choices = [sorted(groups[sample.layout, sample.group]) for sample in samples]
    chance = float(np.mean([1 / len(names) for names in choices]))
    report: dict[str, Any] = {"samples": len(y), "chance": round(chance, 4)}
    for name, classifier in classifiers().items():
        guesses = _guessed(classifier, x, y, layouts, choices)
        rate = Rate(int((guesses == y).sum()), len(y))
        low, high = rate.interval
        report[name] = {
            "accuracy": round(rate.value, 4),
            "low": round(low, 4),
            "high": round(high, 4),
        }
    report["blind"] = all(report[name]["high"] <= chance + MARGIN for name in classifiers())
    return report


def _guessed(
    classifier: Pipeline,
    x: NDArray[np.float64],
    y: NDArray[np.str_],
    layouts: NDArray[np.int64],
    choices: Sequence[Sequence[str]],
) -> NDArray[np.str_]:
    """(n,) of a group's labels the likeliest; whole layouts are left out of the training."""
    folds = GroupKFold(FOLDS)
    likely = cross_val_predict(classifier, x, y, groups=layouts, cv=folds, method="predict_proba")
    column = {label: number for number, label in enumerate(np.unique(y))}
    return np.array(
        [
            max(names, key=lambda name: row[column[name]])
            for row, names in zip(likely, choices, strict=True)
        ]
    )
