"""Builds the devices and plants of virtual stations, as a line file describes them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from random import Random

from jbclog.config.line import AUTO, StationSpec
from jbclog.config.sim_spec import KEYS_OF_FAULT, SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family, family_of
from jbclog.protocol.commands.hotair import AIR_STATUS
from jbclog.protocol.commands.signals import DISPENSING_COUNTERS
from jbclog.sim.device import Identity, RobotDevice
from jbclog.sim.faults import OF_OMEGA, KnownNames
from jbclog.sim.hotair import PORT as AIR_PORT
from jbclog.sim.hotair import AirPlant, AirStation, AirTraits, Heater
from jbclog.sim.plant import Plant, TableRequest
from jbclog.sim.port import PortTraits, SimPort, fresh
from jbclog.sim.quirks import QUIRKS, Quirks
from jbclog.sim.soldering import SolderingPlant
from jbclog.sim.soldering_station import Feeder, SolderingStation, StationSettings
from jbclog.sim.tip import JointSchedule, Tip

MODELS = {"soldering": "DDR", "ucr": "UCR245"}  # model of a family; otherwise its name
PORTS_IF_UNPRINTED = (1, 2)
TIP_W, HOT_AIR_W = 130.0, 900.0


def family_for(spec: StationSpec) -> Family:
    """Return the family of a virtual station; ``auto`` is resolved by its model."""
    name = spec.sim.family if spec.sim and spec.sim.family else spec.family
    given = spec.sim.model if spec.sim else None
    family = FAMILIES.get(name) if name != AUTO else family_of(given or "")
    if family is None:
        raise UsageError(
            f"{spec.name}: there is no virtual station of family {spec.family}; [station.sim] model"
            " can name one"
        )
    return family


def build_device(spec: StationSpec, now: float, seed: int) -> RobotDevice:
    """Build the device of a station that is switched on at `now`."""
    sim = spec.sim or SimSpec()
    family = family_for(spec)
    model = sim.model or spec.model or MODELS.get(family.name, family.name.upper())
    face = _face(sim, family, spec.ports or family.ports or PORTS_IF_UNPRINTED, model, now, seed)
    _check_names(spec.name, sim, family, face.ports)
    quirks = Quirks(sim.quirks)
    quirks.begin(face)
    device = RobotDevice(
        family, face, Identity(model, sim.software, spec.address, sim.robot_mode), quirks
    )
    for name, value in sim.settings.items():
        _set_initial(device, spec.name, name, value, now)
    return device


def _face(
    sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int
) -> Plant:
    if family.status is AIR_STATUS:
        return AirPlant(_air_station(sim, now, seed))
    return SolderingPlant(
        family,
        _soldering_station(sim, family, ports, model, now, seed),
        strict=sim.refuses_unprinted,
    )


def _check_names(station: str, sim: SimSpec, family: Family, ports: Collection[int]) -> None:
    counters = {counter.command for counter in (*family.counters, *DISPENSING_COUNTERS)}
    known = KnownNames(
        counters=counters & set(family.commands),
        quirks=QUIRKS,
        faults=set(KEYS_OF_FAULT) - OF_OMEGA,
        commands=family.commands,
        ports=ports,
    )
    known.reject_others(station, sim, f"a {family.name} with ports {list(ports)}")


def _soldering_station(
    sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int
) -> SolderingStation:
    feeder = Feeder()
    on_joint = feeder.start if sim.feed_each_joint else None
    return SolderingStation(
        began=now,
        ports={number: _port(sim, number, now, seed * 5 + number, on_joint) for number in ports},
        feeder=feeder,
        factory=fresh(StationSettings, family.defaults, model),
        start_counts=sim.counters,
    )


def _air_station(sim: SimSpec, now: float, seed: int) -> AirStation:
    character = AirTraits(
        sim.noise_c,
        sim.sensor_error_c,
        Random(seed),
        has_thermocouple=sim.thermocouple,
        lifts_parts=sim.suction_each_joint,
    )
    heater = Heater(sim.ambient_c, sim.rated_power_w or HOT_AIR_W)
    joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return AirStation(
        now, sim.tools.get(AIR_PORT, sim.tool), heater, joints, character, sim.counters
    )


def _port(
    sim: SimSpec, number: int, now: float, seed: int, on_joint: Callable[[float], None] | None
) -> SimPort:
    character = PortTraits(
        sim.noise_c,
        sim.sensor_error_c,
        Random(seed),
        extractor_cools=sim.extractor_cools,
        on_joint=on_joint,
    )
    joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return SimPort(
        now,
        sim.tools.get(number, sim.tool),
        Tip(sim.ambient_c, sim.rated_power_w or TIP_W),
        joints,
        character,
    )


def _set_initial(
    device: RobotDevice, station: str, name: str, given: int | float | str, now: float
) -> None:
    """Apply an initial setting on all ports and tools."""
    command = device.family.commands.get(name)
    value = _value(device, name, given)
    if command is None or "rw" not in command.access or not device.face.allowed(command, value):
        raise UsageError(
            f"{station}: [station.sim] settings: {name} = {given} is nothing that a"
            f" {device.family.name} can begin with"
        )
    ports = [0] if command.scope is Scope.STATION else list(device.face.ports)
    tools = [tool for tool in device.family.tools if tool] if command.scope is Scope.TOOL else [0]
    for port in ports:
        for tool in tools:
            device.face.apply(TableRequest(command, "", port, tool), value, now)
    device.face.keep()


def _value(device: RobotDevice, name: str, given: int | float | str) -> Value:
    if name == "status" and isinstance(given, str):
        return device.family.status.orders.get(given, given)
    return OFF if given == "off" and name.endswith("_delay") else given
