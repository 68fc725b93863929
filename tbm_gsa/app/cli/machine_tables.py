"""The tables of `tbm-monitor machine show`: summary document → terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Table

from tbm_dynamics.machine.summary import BETWEEN, DRIVE_NODES, PLACES, STRUCTURES, SUBSYSTEMS
from tbm_gsa.app.cli.output import add_row, narrow_table, print_sentence, results
from tbm_gsa.paper.load_summary import LoadSummary

_AXES = (">x", ">y", ">z", ">rx", ">ry", ">rz")
_DRIVE_AXES = (">x", ">r", ">t", ">rx", ">rr", ">rt")


def print_tables(document: dict[str, Any]) -> None:
    """Print the document of `machine_summary` as tables; every value with its unit and its source."""
    point = document["operating_point"]
    print_sentence(f"{document['machine']}: {document['title']}")
    print_sentence(
        f"operating point {point['speed_r_min']:g} r/min, {point['torque_kn_m']:g} kN·m, {point['thrust_kn']:g} kN "
        f"({point['source']}); {document['degrees_of_freedom']} degrees of freedom"
    )
    if limits := document["operating_limits"]:
        print_sentence(
            f"limits {limits['speed_r_min']:g} r/min, {limits['torque_kn_m']:g} kN·m, {limits['thrust_kn']:g} kN, "
            f"{limits['power_kw']:g} kW ({limits['source']})"
        )
    for name in STRUCTURES:
        nodes = [node for node in document["nodes"] if node["subsystem"] == name]
        _print_nodes(f"nodes: {name} (places {document['places'][name]})", nodes)
    _print_parts(document)
    for where in (*STRUCTURES, BETWEEN):
        chosen = [item for item in document["connections"] if item["where"] == where]
        rows = ((item["name"], "–".join(map(str, item["between"])), item) for item in chosen)
        _print_connections(f"connections: {where}; N/m along and N·m/rad about", _AXES, rows)
    _print_drives(document["drives"])
    if document["cutters"]:
        _print_cutters(document["cutters"])
    _print_masses(document["masses"])
    _print_modes(document)
    _print_sources(document["sources"])


def _table(title: str, *headings: str) -> Table:
    return narrow_table(f"\n{title}", *headings)


def _short(value: float) -> str:
    """1e10 and 5e9 rather than 1e+10 and 5e+09."""
    return f"{value:.3g}".replace("e+0", "e").replace("e+", "e")


def _print_nodes(title: str, nodes: Sequence[dict[str, Any]]) -> None:
    table = _table(title, ">node", ">x, m", ">y, m", ">z, m", "")
    for node in nodes:
        add_row(table, *(node["node"], *(f"{value:g}" for value in node["place"]), ", ".join(node["roles"])))
    results.print(table)


def _print_parts(document: dict[str, Any]) -> None:
    table = _table("shafts", "nodes", ">outer, m", ">inner, m", ">mass, kg", "source")
    for shaft in document["shafts"]:
        numbers = (f"{shaft[key]:g}" for key in ("outer_diameter", "inner_diameter", "mass"))
        add_row(table, *("–".join(map(str, shaft["nodes"])), *numbers, shaft["source"]))
    results.print(table)
    table = _table("bodies", "node", ">mass, kg", ">about x, kg·m²", ">about y", ">about z", "source")
    for body in document["bodies"]:
        add_row(
            table, *(body["node"], f"{body['mass']:g}", *(f"{value:g}" for value in body["inertia"]), body["source"])
        )
    results.print(table)


def _print_connections(title: str, axes: Sequence[str], rows: Iterable[tuple[str, str, dict[str, Any]]]) -> None:
    table = _table(title, "name", "between", "type", *axes, "source")
    for name, between, item in rows:
        add_row(table, *(name, between, item["type"], *map(_short, item["stiffness"]), item["source"]))
    results.print(table)


def _print_drives(drives: dict[str, Any]) -> None:
    placement = drives["placement"]
    table = _table(
        f"drives: {drives['count']} ({drives['source']})", "drive", ">angle, °", *(f">{n}" for n in DRIVE_NODES)
    )
    for member in drives["members"]:
        add_row(table, *(member["drive"], f"{member['angle_deg']:g}", *member["nodes"]))
    add_row(table, *("x, m", "", *(f"{placement[name]:g}" for name in PLACES)))
    results.print(table)
    print_sentence(
        f"{drives['radius']:.4g} m off the axis (places {placement['source']}), "
        f"mounted on node {drives['mount_node']}, driving the ring gear at node {drives['ring_node']}"
    )
    front, _, rear, output, rotor = drives["members"][0]["nodes"]
    mount = drives["mount_node"]
    between = (f"{front}, {rear}–{mount}", f"{rear}–{output}", f"{output}, {rotor}–{mount}")
    rows = ((item["name"], ends, item) for ends, item in zip(between, drives["connections"], strict=True))
    title = "connections of drive 1; N/m along and N·m/rad about x, radial r, tangential t"
    _print_connections(title, _DRIVE_AXES, rows)
    columns = (">outer, m", ">inner, m", ">mass, kg", ">about x, kg·m²", ">across", "source")
    table = _table("parts of a drive", "part", *columns)
    for name, part in drives["parts"].items():
        values = (part.get(key) for key in ("outer_diameter", "inner_diameter", "mass"))
        cells = (*values, *part.get("inertia", (None, None))[:2])
        add_row(table, *(name, *("" if value is None else f"{value:g}" for value in cells), part["source"]))
    results.print(table)
    _print_gears(drives)
    _print_gearbox(drives["gearbox"])


def _print_gears(drives: dict[str, Any]) -> None:
    gear, mesh = drives["gear"], drives["mesh"]
    headings = ("pair", "teeth", ">m, mm", ">α, °", ">b, mm", ">ε", ">mesh, Hz", "source")
    table = _table("gear pairs, from the ring to the motor", *headings)

    def add(pair: str, teeth: str, entry: dict[str, Any], contact_ratio: float) -> None:
        size = (1e3 * entry["module"], entry["pressure_angle_deg"], 1e3 * entry["face_width"])
        rest = (f"{contact_ratio:.3f}", f"{entry['mesh_frequency_hz']:.2f}", entry["source"])
        add_row(table, *(pair, teeth, *(f"{value:g}" for value in size), *rest))

    add("ring/pinion", f"{gear['ring_teeth']}/{gear['pinion_teeth']}", gear, gear["contact_ratio"])
    for number, stage in enumerate(drives["gearbox"]["stages"], start=1):
        ring, planet, sun = stage["ring_teeth"], stage["planet_teeth"], stage["sun_teeth"]
        add(f"stage {number} ring/planet", f"{ring}/{planet}", stage, stage["ring_contact_ratio"])
        add(f"stage {number} planet/sun", f"{planet}/{sun}", stage, stage["sun_contact_ratio"])
    results.print(table)
    print_sentence(
        f"mesh of ring and pinion ({mesh['source']}): {_short(mesh['mean_stiffness'])} N/m, "
        f"backlash {mesh['backlash'] * 1e6:g} µm, damping ratio {mesh['damping_ratio']:g}"
    )


def _print_gearbox(gearbox: dict[str, Any]) -> None:
    headings = ("part", ">planets", ">ratio", ">N·m/rad at the pinion", "source")
    table = _table("gearbox, from the pinion to the motor", *headings)
    for number, stage in enumerate(gearbox["stages"], start=1):
        numbers = (f"{stage['ratio']:.4g}", _short(stage["stiffness"]))
        add_row(table, *(f"stage {number}", stage["planets"], *numbers, stage["source"]))
    add_row(table, *("shafts", "", "", _short(gearbox["shaft_stiffness"]), gearbox["source"]))
    add_row(table, *("together", "", f"{gearbox['ratio']:.4g}", _short(gearbox["stiffness"]), ""))
    results.print(table)
    print_sentence(f"rotor {gearbox['rotor_speed_r_min']:.0f} r/min")


def _print_cutters(cutters: dict[str, Any]) -> None:
    table = _table(f"cutters ({cutters['source']})", "type", ">cutters", ">discs", ">radius, m")
    for name, kind in cutters["types"].items():
        low, high = kind["radius"]
        add_row(table, *(name, kind["cutters"], kind["discs"], f"{low:.3f} to {high:.3f}"))
    results.print(table)
    rock, disc = cutters["rock"], cutters["disc"]
    print_sentence(
        f"discs {2e3 * disc['radius']:g} mm across, tip {1e3 * disc['tip_width']:g} mm ({disc['source']}); "
        f"rock {rock['ucs_mpa']:g} and {rock['bts_mpa']:g} MPa ({rock['source']})"
    )
    print_sentence(
        f"at the operating point {cutters['penetration_mm']:.1f} mm a turn, a face disc "
        f"{cutters['normal_force_kn']:.0f} and {cutters['rolling_force_kn']:.1f} kN"
    )
    print_sentence(
        f"friction {cutters['friction_kn']:g} kN, idle torque {cutters['idle_torque_kn_m']:g} kN·m; "
        f"torque of the head {cutters['torque_kn_m']:.0f} kN·m"
    )


def _print_masses(masses: dict[str, float]) -> None:
    table = _table("masses", "subsystem", ">t")
    for name in (*SUBSYSTEMS, "total"):
        add_row(table, *(name, f"{masses[name] / 1e3:.1f}"))
    results.print(table)


def _print_modes(document: dict[str, Any]) -> None:
    roles = {node["node"]: ", ".join(node["roles"]) for node in document["nodes"]}
    table = _table("lowest natural frequencies", ">Hz", "motion", ">energy", "largest at node")
    for mode in document["modes"]:
        where = f"{mode['node']} {roles[mode['node']]}"
        share = f"{mode['shares'][mode['motion']]:.0%}"
        add_row(table, *(f"{mode['frequency_hz']:.2f}", mode["motion"], share, where))
    results.print(table)


def _print_sources(sources: dict[str, int]) -> None:
    table = _table("numbers of the file by source", "source", ">numbers")
    for name, count in sources.items():
        add_row(table, *(name, count))
    results.print(table)


def print_loads(summary: LoadSummary) -> None:
    """Print loads beside the paper's Table 1; forces in kN, moments in kN·m."""
    point = summary.operating_point
    print_sentence(
        f"{summary.machine}: cutterhead loads, {summary.loads} level, {summary.duration:g} s, seed {summary.seed}, "
        f"at {point.speed * 30.0 / math.pi:.3g} r/min, {point.torque / 1e3:.5g} kN·m, {point.thrust / 1e3:.5g} kN"
    )
    headings = (">paper", ">mean", ">RMS", ">in regions", "paper's lines", "found, Hz")
    title = "means (magnitudes), fluctuation, share of power in Table 1's regions; kN, kN·m"
    table = _table(title, "", *headings)
    for name, row in summary.components.items():
        numbers = (f"{abs(value) / 1e3:.5g}" for value in (row.paper_mean, row.mean, row.rms))
        paper = ", ".join(f"{line.paper_hz:g}" for line in row.lines)
        found = ", ".join("–" if line.found_hz is None else f"{line.found_hz:.2f}" for line in row.lines)
        add_row(table, name, *numbers, f"{row.in_regions:.0%}", paper, found)
    results.print(table)
