"""One episode's world: what can be seen of it, and what an action does to it."""

from collections.abc import Sequence
from time import perf_counter
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.cameras import camera, wrist_camera
from hide_tasks.bullet.executor import Executor, Motion
from hide_tasks.bullet.frames import HAND, link_frames, tip_pose
from hide_tasks.bullet.raster import Renderer
from hide_tasks.bullet.robot import Robot
from hide_tasks.bullet.scene import HZ, Part, Scene
from hide_tasks.bullet.transforms import matrix_to_pose
from hide_tasks.contract import (
    Action,
    CameraView,
    Event,
    Failure,
    Keyframe,
    Observation,
)
from hide_tasks.task import Task

FRAME = HZ // 20  # physics steps between two frames of a recording
STILL = HZ // 2  # physics steps at most that things may take to come to rest


class Camcorder(Protocol):
    """Whoever wants to see the world move."""

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Called 20 times per simulated second with the transforms (n, 4, 4) of the parts."""


class World:
    """A task's scene with a robot in it. A context: leaving it frees the simulator."""

    def __init__(self, task: Task, camcorders: Sequence[Camcorder] = ()):
        self.task, self.camcorders = task, camcorders
        self.time, self.steps, self.renders = 0.0, 0, 0
        self.seconds = {"physics": 0.0, "rendering": 0.0}
        self.events: list[Event] = []
        self.violations: list[Failure] = []
        self.success = False
        self._watching = False
        self.scene = Scene(task.layout)
        self.robot = Robot(self.scene, self.step)
        self.executor = Executor(self.robot)
        task.robot = self.executor
        self.parts: list[Part] = [*self.robot.parts(), *self.scene.parts()]
        self.renderer = Renderer([part.mesh for part in self.parts])
        self.settle()
        self.time, self.steps, self._watching = 0.0, 0, True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.scene.close()

    def step(self) -> None:
        """One 240th of a second."""
        start = perf_counter()
        self.scene.client.stepSimulation()
        self.seconds["physics"] += perf_counter() - start
        self.steps += 1
        self.time = self.steps / HZ
        self.scene.refresh()
        if self._watching:
            self._watch()

    def settle(self) -> None:
        """Wait until nothing moves, half a second at most."""
        for step in range(STILL):
            self.step()
            if step % 12 == 11 and self.scene.still():
                break
        self.robot.rest()

    def execute(self, action: Action) -> Motion:
        """Carry out an action; after a keyframe, wait until things are at rest."""
        motion = self.executor.execute(action)
        if isinstance(action, Keyframe) and motion.outcome.moved:
            self.settle()
        return motion

    def poses(self) -> NDArray[np.float64]:
        """(n, 4, 4) world transforms of the parts."""
        return np.concatenate(
            [np.array(list(self.robot.poses())).reshape(-1, 4, 4), self.scene.poses()]
        )

    def observe(self) -> Observation:
        """What a policy sees now."""
        start = perf_counter()
        joints = self.robot.joints
        hand = link_frames(joints)[HAND]
        names = self.task.cameras
        cameras = [wrist_camera(hand) if name == "wrist" else camera(name) for name in names]
        images = self.renderer.render(cameras, self.poses())
        self.ids = images.ids  # segmentation: for experts and logs only
        views = {
            name: CameraView(
                images.rgb[i], images.depth[i], cameras[i].intrinsics, cameras[i].camera_to_world
            )
            for i, name in enumerate(names)
        }
        self.seconds["rendering"] += perf_counter() - start
        self.renders += 1
        return Observation(
            views=views,
            gripper_pose=matrix_to_pose(tip_pose(joints)),
            gripper_opening=self.robot.opening,
            joint_positions=joints,
            instruction=self.task.instruction,
        )

    def _watch(self) -> None:
        events = self.task.watch(self.time)
        self.events += events
        if not self.success and all(self.task.checks().values()):
            self.success = True
        if events or self.steps % FRAME == 0:
            seen = [v for v in self.task.violations() if v not in self.violations]
            self.violations += seen
        if self.camcorders and self.steps % FRAME == 0:
            poses = self.poses()
            for camcorder in self.camcorders:
                camcorder.frame(self.time, poses)
