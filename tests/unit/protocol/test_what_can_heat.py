"""Of each command that a run writes the tables say whether a tool can get warmer by it."""

from __future__ import annotations

from support.product import CAN_HEAT, CANNOT_HEAT, COMMAND_OF, RUN_WRITES


def test_each_written_command_either_can_heat_or_cannot() -> None:
    # which belongs to no start
    assert set(CAN_HEAT) | set(CANNOT_HEAT) == set(RUN_WRITES) - {"stop_feeding"}
    assert not set(CAN_HEAT) & set(CANNOT_HEAT)


def test_what_can_heat_comes_last_in_the_order_of_each_kind_of_tool() -> None:
    on_tips = [
        command in CAN_HEAT
        for key, command in COMMAND_OF.items()
        if not key.startswith(("air.", "feeder."))
    ]
    assert on_tips == sorted(on_tips)


def test_every_setpoint_can_heat() -> None:
    setpoints = {
        command
        for key, command in COMMAND_OF.items()
        if key.endswith((".select_c", ".temperature_c", "setpoint_c"))
    }
    assert setpoints <= set(CAN_HEAT)
