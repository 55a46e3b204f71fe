"""Builds the physics and the device of a station from what its line file says."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from jbclog.config.line import AUTO, StationSpec
from jbclog.config.sim_spec import SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family, family_of
from jbclog.protocol.commands.hotair import AIR_STATUS
from jbclog.protocol.commands.signals import DISPENSING_COUNTERS
from jbclog.sim.air import Heater
from jbclog.sim.airface import PORT as AIR_PORT
from jbclog.sim.airface import AirFace
from jbclog.sim.airstation import AirCharacter, AirStation
from jbclog.sim.device import Device
from jbclog.sim.face import Face
from jbclog.sim.factory_settings import fresh
from jbclog.sim.faults import OF_OMEGA
from jbclog.sim.plant import Feeder, Plant, StationSettings
from jbclog.sim.port import Character, Port
from jbclog.sim.questions import Asked
from jbclog.sim.quirks import QUIRKS, Quirks
from jbclog.sim.readings import Identity
from jbclog.sim.soldering import SolderingFace
from jbclog.sim.tip import Joints, Tip

MODELS = {"soldering": "DDR", "ucr": "UCR245"}  # elsewhere the family's name is the model's
PORTS_IF_UNPRINTED = (1, 2)
TIP_W, HOT_AIR_W = 130.0, 900.0


def family_for(spec: StationSpec) -> Family:
    """The family that a virtual station of this description has; ``auto`` goes by the model that it tells."""
    name = spec.sim.family if spec.sim and spec.sim.family else spec.family
    told = spec.sim.model if spec.sim else None
    family = FAMILIES.get(name) if name != AUTO else family_of(told or "")
    if family is None:
        raise UsageError(f"{spec.name}: there is no virtual station of family {spec.family}; [station.sim] model can name one")
    return family


def build_device(spec: StationSpec, now: float, seed: int) -> Device:
    """The device of a station that is switched on at `now`."""
    sim = spec.sim or SimSpec()
    family = family_for(spec)
    model = sim.model or spec.model or MODELS.get(family.name, family.name.upper())
    face = _face(sim, family, spec.ports or family.ports or PORTS_IF_UNPRINTED, model, now, seed)
    _check_names(spec.name, sim, family, face)
    quirks = Quirks(sim.quirks)
    quirks.begin(face)
    device = Device(family, face, Identity(model, sim.software, spec.address, sim.robot_mode), quirks)
    for name, value in sim.settings.items():
        _begin_with(device, spec.name, name, value, now)
    return device


def _face(sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int) -> Face:
    if family.status is AIR_STATUS:
        return AirFace(_air_station(sim, now, seed))
    return SolderingFace(family, _plant(sim, family, ports, model, now, seed), strict=sim.refuses_unprinted)


def _check_names(station: str, sim: SimSpec, family: Family, face: Face) -> None:
    """A counter, a command or a port that is not there would silently do nothing."""
    counters = {counter.command for counter in (*family.counters, *DISPENSING_COUNTERS)} & set(family.commands)
    wrong = [f"counters: {name}" for name in sim.counters if name not in counters]
    wrong += [f"tools: {port}" for port in sim.tools if port not in face.ports]
    wrong += [f"quirks: {name}" for name in sim.quirks if name not in QUIRKS]
    for fault in sim.fault:
        wrong += [f"fault {fault.kind}"] if fault.kind in OF_OMEGA else []
        wrong += [f"fault {fault.kind}: {fault.command}"] if fault.command and fault.command not in family.commands else []
        wrong += [f"fault {fault.kind}: port {fault.port}"] if fault.port and fault.port not in face.ports else []
    if wrong:
        raise UsageError(f"{station}: [station.sim] {', '.join(wrong)}: a {family.name} with ports {list(face.ports)} has none")


def _plant(sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int) -> Plant:
    feeder = Feeder()
    on_joint = feeder.start if sim.feed_each_joint else None
    return Plant(
        began=now,
        ports={number: _port(sim, number, now, seed * 5 + number, on_joint) for number in ports},
        feeder=feeder,
        factory=fresh(StationSettings, family.defaults, model),
        start_counts=sim.counters,
    )


def _air_station(sim: SimSpec, now: float, seed: int) -> AirStation:
    character = AirCharacter(sim.noise_c, sim.sensor_error_c, sim.thermocouple, sim.suction_each_joint, Random(seed))
    heater = Heater(sim.ambient_c, sim.rated_power_w or HOT_AIR_W)
    joints = Joints(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return AirStation(now, sim.tools.get(AIR_PORT, sim.tool), heater, joints, character, sim.counters)


def _port(sim: SimSpec, number: int, now: float, seed: int, on_joint: Callable[[float], None] | None) -> Port:
    character = Character(sim.noise_c, sim.sensor_error_c, sim.extractor_cools, Random(seed), on_joint)
    joints = Joints(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return Port(now, sim.tools.get(number, sim.tool), Tip(sim.ambient_c, sim.rated_power_w or TIP_W), joints, character)


def _begin_with(device: Device, station: str, name: str, told: int | float | str, now: float) -> None:
    """Let the station begin with a setting, on all of its ports and tools."""
    command = device.family.commands.get(name)
    value = _value(device, name, told)
    if command is None or "rw" not in command.access or not device.face.allowed(command, value):
        raise UsageError(
            f"{station}: [station.sim] settings: {name} = {told} is nothing that a {device.family.name} can begin with"
        )
    ports = [0] if command.scope is Scope.STATION else list(device.face.ports)
    tools = [tool for tool in device.family.tools if tool] if command.scope is Scope.TOOL else [0]
    for port in ports:
        for tool in tools:
            device.face.apply(Asked(command, "", port, tool), value, now)
    device.face.keep()


def _value(device: Device, name: str, told: int | float | str) -> Value:
    if name == "status" and isinstance(told, str):
        return device.family.status.orders.get(told, told)
    return OFF if told == "off" and name.endswith("_delay") else told
