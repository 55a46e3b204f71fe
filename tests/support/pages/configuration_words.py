"""What the keys of recipes, line files, jobs files and tasks files mean, for the page that lists
them.
"""

from __future__ import annotations

from collections.abc import Mapping

TABLES: Mapping[str, str] = {
    "Recipe": (
        "What a job asks of its stations and how it is judged. Required is `[recipe]` only. A"
        " missing key leaves the station's value alone: it is read and recorded, not written."
        " `[port.N.temperature]`, `[port.N.sleep]`, `[port.N.hibernation]` and"
        " `[port.N.alarm.high]`, `[port.N.alarm.low]` hold for one port. A table that a station"
        " does not have is skipped for it (`unsupported`); one that none of the recipe's families"
        " has is an error."
    ),
    "Line file": (
        "Which stations there are and how they are connected. `[[station]]` comes once for each."
        " `[station.sim]` describes the virtual station of that name: `jbclog sim` serves it,"
        " `jbclog run` ignores it."
    ),
    "Jobs file": (
        "A queue of runs for `jbclog batch`. `[[job]]` comes once for each. A job needs one end:"
        " `duration`, `units` or `joints`; a `duration` beside the others is the bound."
    ),
    "Tasks file": (
        "Maintenance tasks for `jbclog audit --tasks`. `[[task]]` comes once for each, with one"
        " service interval: `life_h`, `life_cycles` or `life_m` of a counter, or `life_days`."
    ),
}

_FIELD = "one of the condition's fifteen fields"
_RECIPE = {
    "recipe.name": "name of the recipe",
    "recipe.revision": (
        "number that is raised with every change; the record keeps it with the file's SHA-256"
    ),
    "recipe.families": "families that the recipe is for; a station of another is refused",
    "temperature.select_c": "setpoint; the maximum is the station's own (R-MAT)",
    "temperature.adjust_c": (
        "offset found with an external thermometer, for the tool that is connected at the start"
    ),
    "sleep.temperature_c": "temperature of a tool that sleeps",
    "sleep.delay_min": "time from stand to sleep; off: it never sleeps",
    "hibernation.delay_min": "time from sleep to hibernation (heater off); off: never",
    "alarm.high.limit_c": "the station raises its flag above this",
    "alarm.high.delay_s": "for at least this long; off disables the alarm",
    "alarm.low.limit_c": "the station raises its flag below this",
    "alarm.low.delay_s": "for at least this long; off disables the alarm",
    "feeder.mode": "`ale`: how the feeder runs; a recipe never starts it",
    "feeder.length_mm": "`ale`: length of one feed",
    "feeder.speed_mm_s": "`ale`: feed speed",
    "feeder.diameter_mm": "`ale`: diameter of the solder wire",
    "feeder.backward_mm": "`ale`: length that is pulled back after a feed",
    "feeder.clog_detection": "`ale`: clog detection on or off",
    "air.temperature_c": "`jtse`: selected air temperature",
    "air.flow_permille": "`jtse`: air flow as a share of R-MAF; no manual prints its unit",
    "air.external_set_c": "`jtse`: selected temperature of the external thermocouple",
    "air.mode": "`jtse`: work mode",
    "air.suction": "`jtse`: suction at the start; keep where the key is missing",
    "omega.condition": (
        "`omega`: number of the solder condition; written only with `--allow-omega-write`,"
        " otherwise compared"
    ),
    "omega.mode": "`omega`: soldering mode of the condition",
    **dict.fromkeys(
        [
            f"omega.{name}"
            for name in [
                *("rise_s", "preheat_s", "heating_s"),
                *(
                    f"{kind}{number}_{unit}"
                    for kind in ("feed", "reverse")
                    for number in (1, 2, 3)
                    for unit in ("mm", "mm_s")
                ),
            ]
        ],
        _FIELD,
    ),
    "sampling.rate_hz": (
        "rate of temperature, power and status. auto: the highest of 10, 5, 4, 2, 1, 0.5 … Hz that"
        " leaves a fifth of the link free, after the response time was measured; a number is a"
        " demand. Without it 10 Hz, on `omega` 1 Hz"
    ),
    "sampling.alarms_every_s": "longest time between two readings of alarm flags and port error",
    "sampling.counters_every_s": (
        "longest time between two readings of counters, alarm limits and identity"
    ),
    "run.status": "state that each tool is put in at the start; without it the state is left alone",
    "run.safe_state": (
        "state that each touched tool is put in at the end; without it stand, on `jtse` cooling"
    ),
    "run.safe_suction": "`jtse`: suction at the end",
    "run.require_tool": (
        "whether a named port without a tool stops the start; if not, it is recorded as `no_tool`"
    ),
    "run.on_difference": (
        "what a setting does that is found changed during the run: stop this station, or record it"
    ),
    "run.on_missing": (
        "whether the run starts without stations that are missing or refuse; `run --allow-missing`"
        " once"
    ),
    "run.allow_no_cooldown": (
        "whether a run starts while a sleep or hibernation delay is off, so that the tip does not"
        " cool"
    ),
    "episodes.dead_band_c": "deadband of alarms computed from samples",
    "episodes.off_delay_s": "their off-delay; without it the on-delay, which is the station's",
    "episodes.stale_s": "time without a reading after which such an alarm is uncertain",
    "metadata.required": "what `run` demands on its command line",
    "units.repeat": "what happens with a serial that was read before",
    "joints.least_dwell_s": (
        "shortest heat draw that is a joint; without it 0.25 s or 0.6 sampling periods, the longer"
    ),
    "joints.merge_gap_s": (
        "contacts closer together are one joint; without it 0.25 s or one sampling period, the"
        " longer"
    ),
    "joints.expected_every_s": (
        "usual time between joints; helps to separate two contacts, never makes a joint"
    ),
    "joints.recovered_within_c": "band around the level at rest that counts as recovered",
    "joints.wire_decides": (
        "whether each feed of the feeder is a joint; without it unless more draws lack a feed than"
        " there are feeds"
    ),
    "acceptance.coverage_percent": "coverage: readings obtained of the readings due, at least",
    "acceptance.longest_gap_s": "longest gap between two readings, at most; a period more is allowed",
    "acceptance.idle_error_c": "mean deviation of a tip at rest from its setpoint, at most",
    "acceptance.idle_sd_c": "standard deviation of a tip at rest, at most",
    "acceptance.alarms_max": "alarms that are accepted",
    "acceptance.verification_days": (
        "age of the last passed tip verification (`jbclog verify`), at most"
    ),
    "acceptance.recovery_p95_s": "95th percentile of the recovery time, at most; needs 59 joints",
    "acceptance.recovered_before_next_percent": (
        "joints after which the tip had recovered before the next one, at least"
    ),
    "acceptance.joints_against_counter_percent": (
        "`ale`: difference between joints found and feeds counted, at most"
    ),
    "acceptance.reached_within_c": (
        "band around the setpoint that counts as reached; without it 10 °C"
    ),
    "acceptance.at_work_percent": (
        "share of the readings due since the first arrival in which the tool is at work, at least; "
        "0: it need not work"
    ),
    "acceptance.confidence": (
        "confidence of the bounds that keep the limits; none judges bare figures, and the verdict"
        " says so"
    ),
}

_LINE = {
    "line.name": "name of the production line",
    "station.name": "name of the station",
    "station.url": "port; any URL of pyserial",
    "station.family": "how the station is driven; auto asks it for its model name",
    "station.model": (
        "model name that no manual prints, or of a sister family, and that is accepted"
    ),
    "station.baudrate": "baud rate",
    "station.format": "data bits, parity, stop bits",
    "station.address": "address of the station; the recorder's is 0",
    "station.ports": (
        "tool connectors that are used; without it the family's own, or those that answer R-CT"
    ),
    "station.turnaround_ms": "response time that `plan` calculates with; `run` measures it",
    "station.recipe": "recipe for this station in place of the one on the command line",
    "station.rated_power_w": "turns per mille into watts; without it energy is relative",
    "station.sim.turnaround_ms": "response time; an `omega` answers after 0 to 250 ms without it",
    "station.sim.wire": "whether answers take the time that the baud rate needs",
    "station.sim.family": "what the station really is, where the line file says another",
    "station.sim.model": "model name that it gives",
    "station.sim.software": "software version that it gives",
    "station.sim.robot_mode": "whether Robot mode is on at its menu",
    "station.sim.tool": "number of the tool in every port; 0: none",
    "station.sim.tools": "numbers of tools by port",
    "station.sim.joints_per_minute": "joints that it makes",
    "station.sim.joint_seconds": "length of a joint",
    "station.sim.feed_each_joint": "`ale`: the robot's own switch starts a feed in each joint",
    "station.sim.noise_c": "standard deviation of the temperature reading",
    "station.sim.sensor_error_c": "reading minus true tip temperature",
    "station.sim.ambient_c": "ambient temperature",
    "station.sim.rated_power_w": "power at 1000 ‰; without it 130 W, hot air 900 W",
    "station.sim.thermocouple": "`jtse`: whether an external thermocouple is connected",
    "station.sim.suction_each_joint": "`jtse`: a part is lifted after each joint",
    "station.sim.refuses_unprinted": (
        "refuses (N 00003) what is beyond a limit that only another manual prints"
    ),
    "station.sim.extractor_cools": "whether the heater is off in status 00010; no manual says",
    "station.sim.quirks": (
        "other readings of the manuals, by the names in [contradictions](contradictions.md)"
    ),
    "station.sim.settings": "settings that it begins with, by command name",
    "station.sim.counters": "counters that it begins with, by command name",
    "station.sim.seed": "seed of joints, noise and flipped bits; without it the station's name",
    "station.sim.faults_from": (
        "what the times of its faults count from: its first question, or its first order to a tool"
        " to work or rest (not `omega`)"
    ),
    "station.sim.fault.kind": "the fault, see below",
    "station.sim.fault.at_s": "begin, in seconds from the first question, or as `faults_from` says",
    "station.sim.fault.for_s": "how long; without it to the end",
    "station.sim.fault.command": "only answers of this command",
    "station.sim.fault.port": "only this port",
    "station.sim.fault.only": "only answers to reads, or to writes",
    "station.sim.fault.every": "every nth of those answers",
    "station.sim.fault.code": "number of the refusal, or of the tool",
    "station.sim.fault.bits": "bits that are turned over",
    "station.sim.fault.bytes_count": "random bytes before the answer",
    "station.sim.fault.by_s": "delay of the answer",
    "station.sim.fault.by_c": "how far above the upper alarm limit",
}

_JOBS = {
    "batch.line": "line file",
    "batch.on_failure": (
        "what a failed job means: stop the batch, skip what waits for it, or continue"
    ),
    "job.name": "name of the job",
    "job.recipe": "recipe",
    "job.stations": "stations that it runs on; without it and `families` all of the line",
    "job.families": "stations by family",
    "job.duration": "how long to record",
    "job.units": "ends after this many finished units",
    "job.joints": "ends after this many joints on all its stations together",
    "job.units_from": "where serials are read from while the job runs",
    "job.at": "earliest start, local time; fixed when the batch begins",
    "job.after": "jobs that must be done before",
    "job.on_failure": "as in `[batch]`, for this job",
    "job.operator": "`run --operator`",
    "job.order": "`run --order`",
    "job.product": "`run --product`",
    "job.serials": "`run --unit`",
    "job.wire_lots": "`run --wire-lot`",
    "job.flux_lots": "`run --flux-lot`",
    "job.tips": "`run --tip`",
    "job.tags": "`run --tag`",
    "job.rate": "`run --rate`",
    "job.wire": "keeps a serial capture",
    "job.allow_omega_write": "`run --allow-omega-write`",
    "job.allow_missing": "`run --allow-missing`",
}

_TASKS = {
    "task.name": "name, as `jbclog maintenance done --task` takes it",
    "task.title": "text for tables and pages; without it the name",
    "task.counter": "counter that measures the use",
    "task.life_h": "service interval of an hour counter",
    "task.life_cycles": "service interval of a cycle counter",
    "task.life_m": "service interval of the dispensed length",
    "task.life_days": "service interval by calendar, without a counter",
    "task.warn_percent": "share of the interval from which a warning is given",
    "task.families": "only stations of these families",
    "task.stations": "only these stations",
    "task.of": "whether each port counts by itself, or all ports of a station together",
}

MEANINGS: Mapping[str, Mapping[str, str]] = {
    "Recipe": _RECIPE,
    "Line file": _LINE,
    "Jobs file": _JOBS,
    "Tasks file": _TASKS,
}
"""File -> table and key -> meaning."""

FAULTS: Mapping[str, str] = {
    "silence": "the station hears and acts, and its answer does not come",
    "noise": "`bytes_count` random bytes come before the answer",
    "flip": "`bits` bits of the answer are turned over",
    "late": "the answer comes `by_s` seconds late",
    "nak": (
        "the question is refused with `code` (1 to 6, 99999) and not acted upon; an omega"
        " ignores it"
    ),
    "dropout": "the cable is out: the port disappears, and comes back after `for_s`",
    "restart": "the station restarts: volatile settings are lost, and it is silent for `for_s`",
    "stuck": "the temperature reading stays as it was",
    "overheat": (
        "tip or air goes `by_c` above the upper alarm limit (above the setpoint if none is set)"
    ),
    "tool": "the tool is exchanged for the one with number `code`; 0 pulls it out",
    "solder_shortage": "`omega`: no solder left",
    "clog": "`omega`: the solder is clogged",
    "not_ready": "`omega`: the controller prepares, or has an error",
    "out_of_range": "`omega`: the temperature is outside its alarm range",
}
