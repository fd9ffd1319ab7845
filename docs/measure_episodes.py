"""Times expert episodes beside the bare simulator and renderer: docs/measure_episodes.py [N].

For N episodes of every task (default 9): seconds of an episode on one core, split by part, and
the seconds that the same numbers of bare physics steps (following the same joint targets) and
bare renderings of the same scene take. Medians, in one run.
"""

import statistics
import sys
from time import perf_counter

import numpy as np

from hide_tasks import SUITES, suite
from hide_tasks.bullet.cameras import camera, wrist_camera
from hide_tasks.bullet.frames import HAND, link_frames
from hide_tasks.bullet.world import World
from hide_tasks.contract import EpisodeSpec, Timing
from hide_tasks.episode import play
from hide_tasks.policies import Expert

Row = dict[str, float]


def bare(spec: EpisodeSpec, timing: Timing) -> Row:
    """Seconds of as many steps and renderings of the scene without anything of ours around them.

    The steps are those of the expert's first motions, again and again, without readings.
    """
    with World(suite.build(spec)) as world:
        hand = link_frames(world.robot.joints)[HAND]
        cameras = [
            wrist_camera(hand) if name == "wrist" else camera(name) for name in world.task.cameras
        ]
        poses = world.poses()
        step = world.scene.client.stepSimulation
        start = perf_counter()
        for _ in range(timing.steps):
            step()
        stepped = perf_counter()
        for _ in range(timing.renders):
            world.renderer.render(cameras, poses)
        return {"bare steps": stepped - start, "bare renders": perf_counter() - stepped}


def measure(spec: EpisodeSpec) -> Row:
    """One episode's seconds."""
    timing = play(spec, Expert())[0].timing
    parts = {
        "total": timing.total,
        "physics": timing.physics,
        "rendering": timing.rendering,
        "planning": timing.planning,
    }
    rest = timing.total - timing.physics - timing.rendering - timing.planning
    ours = {"rest": rest, "overhead": timing.total / (timing.physics + timing.rendering)}
    return {**parts, **ours, **bare(spec, timing), "steps": timing.steps, "renders": timing.renders}


def main() -> None:
    """Print one line a task."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    for task in SUITES[suite.SUITE]:
        play(suite.episode(task, "val", 0), Expert())
        rows = [measure(spec) for spec in suite.episodes(task, "val", count)]
        medians = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
        shown = "  ".join(f"{name} {np.round(value, 3)}" for name, value in medians.items())
        sys.stdout.write(f"{task}: {shown}\n")


if __name__ == "__main__":
    main()
