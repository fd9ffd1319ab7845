"""Compiles the kernels once, so that workers find them in the cache: part of `make setup`."""

from hide_tasks import ALL_TASKS, suite
from hide_tasks.bullet import planner
from hide_tasks.bullet.world import World


def main() -> None:
    """Plan once and look once."""
    planner.compile_kernels()
    with World(suite.build(suite.episode(ALL_TASKS[0], "train", 0))) as world:
        world.observe()


if __name__ == "__main__":
    main()
