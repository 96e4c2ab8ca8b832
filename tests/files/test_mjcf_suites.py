"""The planar models of Gymnasium and dm_control, against MuJoCo itself (all three in the extra ``robots``)."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import mbdcasadi as mbd

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (pip install .[robots])")
SUITES = {
    "gymnasium/envs/mujoco/assets": "half_cheetah hopper inverted_double_pendulum inverted_pendulum point reacher "
    "swimmer walker2d walker2d_v5",
    "dm_control/suite": "acrobot ball_in_cup cartpole cheetah finger hopper manipulator pendulum point_mass reacher "
    "stacker swimmer walker",
}


def models():
    """Paths of the models that are installed."""
    for folder, names in SUITES.items():
        package, _, inside = folder.partition("/")
        found = find_spec(package)
        for name in names.split() if found is not None and found.origin else ():
            path = Path(found.origin).parent / inside / f"{name}.xml"
            if path.exists():
                yield pytest.param(path, id=f"{package}-{name}")


def coordinates(joint):
    return (joint.angle, joint.angular_velocity) if hasattr(joint, "angle") else (joint.displacement, joint.speed)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
@pytest.mark.parametrize("path", list(models()))
def test_accelerations(path, tmp_path):
    """In random states, without contacts, limits, dry friction and fluids; written and read again they are the same."""
    model = mujoco.MjModel.from_xml_path(str(path))
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_FRICTIONLOSS
    model.opt.density = model.opt.viscosity = 0.0
    robot = mbd.read_mjcf(path, contacts=False)
    mbd.write_mjcf(robot, tmp_path / "m.xml")
    if model.neq:  # which are soft in MuJoCo
        return
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    data.qpos[:] = model.qpos0 + 0.3 * random.standard_normal(model.nq)
    data.qvel[:], data.ctrl[:] = random.standard_normal(model.nv), random.uniform(-0.5, 0.5, model.nu)
    mujoco.mj_forward(model, data)
    for machine in (robot, mbd.read_mjcf(tmp_path / "m.xml")):
        pairs = [coordinates(machine.joint(model.joint(k).name)) for k in range(model.njnt)]
        start = [pair[0] == float(x) for pair, x in zip(pairs, data.qpos, strict=True)]
        start += [pair[1] == float(x) for pair, x in zip(pairs, data.qvel, strict=True)]
        given = dict(zip(machine.inputs, map(float, data.ctrl), strict=True))
        state = mbd.assemble(machine, start, inputs=given)
        found = np.array([state[mbd.time_derivative(pair[1])] for pair in pairs])
        assert np.max(np.abs(found - data.qacc)) < 1e-9 * (1 + np.max(np.abs(data.qacc)))
