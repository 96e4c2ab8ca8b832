"""What the benchmarks with Exudyn share: settings of a run, sensors, and the mechanism of a model in numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from models import Model


def settings(duration: float, steps: int, every: float) -> Any:
    """Settings of a silent run with fixed steps on one thread, whose sensors write at intervals, s."""
    import exudyn as exu

    made = exu.SimulationSettings()
    made.timeIntegration.endTime = duration
    made.timeIntegration.numberOfSteps = steps
    made.timeIntegration.verboseMode = 0
    made.solutionSettings.writeSolutionToFile = False
    made.solutionSettings.sensorsWritePeriod = every
    made.displayStatistics = False
    made.displayComputationTime = False
    made.parallel.numberOfThreads = 1
    return made


def sensor(system: Any, node: Any, kind: str = "Coordinates") -> Any:
    """Add a sensor of a node, of a kind of Exudyn's output variables."""
    import exudyn as exu
    from exudyn import itemInterface as item

    variable = getattr(exu.OutputVariableType, kind)
    return system.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=variable))


def planar_system(model: Model, state: Any) -> tuple[Any, list[Any]]:
    """Build the bodies, pins, springs and loads of a model at a state, and sensors of the positions of its bodies."""
    import exudyn as exu
    from exudyn import itemInterface as item

    system = exu.SystemContainer().AddSystem()
    ground = system.AddObject(item.ObjectGround())
    bodies, sensors = [], []
    for k, data in enumerate(model.bodies):
        part = slice(3 * k, 3 * k + 3)
        node = system.AddNode(
            item.NodeRigidBody2D(referenceCoordinates=list(state.q[part]), initialVelocities=list(state.v[part]))
        )
        bodies.append(
            system.AddObject(
                item.ObjectRigidBody2D(physicsMass=data.mass, physicsInertia=data.inertia, nodeNumber=node)
            )
        )
        sensors.append(sensor(system, node, "Position"))

    def marker(index: int | None, point: tuple[float, float]) -> Any:
        body = ground if index is None else bodies[index]
        return system.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=[*point, 0.0]))

    for pin in model.pins:
        markers = [marker(pin.a, pin.at_a), marker(pin.b, pin.at_b)]
        system.AddObject(item.ObjectJointRevolute2D(markerNumbers=markers))
    for spring in model.springs:
        markers = [marker(spring.a, spring.at_a), marker(spring.b, spring.at_b)]
        system.AddObject(
            item.ObjectConnectorSpringDamper(
                markerNumbers=markers, stiffness=spring.stiffness, referenceLength=spring.free_length
            )
        )
    for k, value in model.torques:
        rigid = system.AddMarker(item.MarkerBodyRigid(bodyNumber=bodies[k]))
        system.AddLoad(item.LoadTorqueVector(markerNumber=rigid, loadVector=[0, 0, value]))
    if model.gravity:
        for body in bodies:
            mass = system.AddMarker(item.MarkerBodyMass(bodyNumber=body))
            system.AddLoad(item.LoadMassProportional(markerNumber=mass, loadVector=[0, -model.gravity, 0]))
    system.Assemble()
    return system, sensors
