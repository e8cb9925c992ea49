"""Render poses of the quadrotor to frames: python -m plants.quadrotor.renderer FLIGHT.npz FRAMES.npy."""

import sys

import mujoco
import numpy as np

from plants.quadrotor.airframe import build_model

CAMERA = {"distance": 0.5, "azimuth": 135.0, "elevation": -25.0}  # m, deg, deg


def render(values: dict[str, float], poses: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return frames (T, height, width, 3) uint8 of poses (T, 7), seen by a camera that goes along."""
    model = build_model(values)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = CAMERA.values()
    frames = np.empty((len(poses), height, width, 3), np.uint8)
    with mujoco.Renderer(model, height, width) as renderer:
        for frame, pose in zip(frames, poses, strict=True):
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            camera.lookat[:] = pose[:3]
            renderer.update_scene(data, camera)
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = (
                False  # takes most of the time without a graphics card
            )
            renderer.render(out=frame)
    return frames


if __name__ == "__main__":
    with np.load(sys.argv[1], allow_pickle=False) as flight:
        given = dict(zip(flight["names"].tolist(), flight["values"].tolist(), strict=True))
        np.save(sys.argv[2], render(given, flight["poses"], *flight["size"].tolist()))
