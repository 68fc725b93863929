"""A drawing of a machine: side view of nodes, shafts and connections, end view of the drives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Patch

from tbm_dynamics import Machine
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.parts import Subsystem
from tbm_dynamics.machine.summary import STRUCTURES, SUBSYSTEMS
from tbm_dynamics.structure.drive import drive_nodes, drive_positions, gear_pair
from tbm_gsa.app.report.picture import PALETTE

# Of the side view, inches: its length, between rows, between parts in a row, of a node from a line that it hides.
_LENGTH, _ROW = 13.0, 0.85
_GAP, _NEAR = 0.4, 0.25

_COLOURS: Final = dict(zip(SUBSYSTEMS, PALETTE, strict=False))
_LABELS: Final = dict(zip(SUBSYSTEMS, ("cutterhead, bearing, gear", "driveshaft", "carrier, girder"), strict=True))
# Dashes too: colours of thin lines are hard to tell apart.
_STYLES: Final[dict[str, tuple[str, str | tuple[int, tuple[float, ...]], str]]] = {
    "rock": ("#000000", (0, (1, 1)), "rock"),
    "bolt": ("#7f7f7f", "-", "bolt"),
    "bearing": ("#CC79A7", "-", "bearing"),
    "spline": ("#8c510a", "-", "spline"),
    "hydraulic": ("#56B4E9", (0, (4, 1.5)), "hydraulic"),
    "steel": ("#b0b0b0", (0, (4, 1, 1, 1)), "steel"),
    "other": ("#e69f00", (0, (2, 1)), "other"),
    "mesh": ("#d00000", "-", "mesh of pinion and ring"),
    "gearbox": ("#6a3d9a", "-", "planetary gearbox"),
}
_TESTED: Final = "#ffe680"
_GROUND: Final = {"facecolor": "white", "edgecolor": "none", "pad": 0.3}  # of labels, that lines do not cross them

Points = dict[int, tuple[float, float]]
"""Node to place in the side view, inches."""


@dataclass(frozen=True)
class _DrawnPart:
    """A shaft through its nodes, or a body at one, with their x (m)."""

    subsystem: str
    nodes: tuple[int, ...]
    x: tuple[float, ...]


@dataclass(frozen=True)
class _Link:
    """A connection of two nodes, or of one with the ground."""

    name: str
    kind: str
    first: int
    second: int | None


def draw_machine(machine: Machine) -> Figure:
    """Draw a machine from the side, one drive standing for all, and its drives from behind."""
    description = machine.description
    figure = Figure(figsize=(15.0, 9.0), layout=ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.08))
    figure.suptitle(f"{machine.name}: {description.title}", fontsize=11, x=0.01, ha="left")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.3, 1.0), width_ratios=(1.3, 1.0))
    links = _links(description)
    _draw_side(figure.add_subplot(grid[0, :]), description, links)
    _draw_end(figure.add_subplot(grid[1, 0]), description)
    _draw_legend(figure.add_subplot(grid[1, 1]), {link.kind for link in links})
    return figure


def _drawn_parts(description: MachineDescription, name: str) -> list[_DrawnPart]:
    """Shafts and bodies of a subsystem; of the driveshaft those of the first drive."""
    chains: list[tuple[int, ...]]
    if name == "driveshaft":
        drive = description.driveshaft
        place = drive_positions(drive, 0, 0.0)
        front, middle, rear, output, rotor = drive_nodes(drive, 0)
        chains = [(front, middle, rear), (output,), (rotor,)]
        return [_DrawnPart(name, nodes, tuple(float(place[node][0]) for node in nodes)) for nodes in chains]
    group: Subsystem = getattr(description, name)
    chains = [*(shaft.nodes for shaft in group.shafts), *((body.node,) for body in group.bodies)]
    places = description.structural_nodes()
    return [_DrawnPart(name, nodes, tuple(places[node][0] for node in nodes)) for nodes in chains]


def _links(description: MachineDescription) -> list[_Link]:
    """List the connections of the structure by name, and those of the first drive."""
    drive, mount = description.driveshaft, description.mount_nodes[0]
    front, middle, rear, output, rotor = drive_nodes(drive, 0)
    ends = ((item, item.between) for item in description.all_connections())
    return [
        *(_Link(item.name, item.type, first, None if isinstance(to, str) else to) for item, (first, to) in ends),
        *(_Link("", drive.pinion_bearing.type, seat, mount) for seat in (front, rear)),
        *(_Link("", drive.gearbox_mount.type, node, mount) for node in (output, rotor)),
        _Link("", drive.spline.type, rear, output),
        _Link("", "mesh", middle, drive.ring_node),
        _Link("", "gearbox", output, rotor),
    ]


def _drawn(values: Sequence[float]) -> dict[float, float]:
    """Where x (m) is drawn: gaps as their square root, as the nodes crowd in front and the girder is long."""
    found = {}
    place = 0.0
    ordered = sorted(set(values))
    for before, value in pairwise([ordered[0], *ordered]):
        place += math.sqrt(value - before)
        found[value] = place
    return {value: _LENGTH * at / (place or 1.0) for value, at in found.items()}


def _arrange(groups: Sequence[Sequence[_DrawnPart]], drawn: Mapping[float, float], links: Sequence[_Link]) -> Points:
    """Place every part in the row of its group where it touches no other and hides fewest connections, rather above."""
    points: Points = {}
    top = 0
    for parts in groups:
        rows: list[list[tuple[float, float]]] = []  # lengths taken
        for part in parts:
            x = [drawn[value] for value in part.x]
            low, high = min(x) - _GAP, max(x) + _GAP
            free = [level for level, row in enumerate(rows) if all(high < start or end < low for start, end in row)]
            trials = {
                level: {node: (at, -_ROW * (top + level)) for node, at in zip(part.nodes, x, strict=True)}
                for level in (*free, len(rows))
            }
            level = min(trials, key=lambda level: _hidden(links, {**points, **trials[level]}))
            points |= trials[level]
            if level == len(rows):
                rows.append([])
            rows[level].append((min(x), max(x)))
        top += len(rows)
    return points


def _hidden(links: Sequence[_Link], points: Points) -> int:
    """Count the nodes that stand on connections of others."""
    count = 0
    for link in links:
        if link.first in points and link.second in points and link.second is not None:
            (ax, ay), (bx, by) = points[link.first], points[link.second]
            square = (bx - ax) ** 2 + (by - ay) ** 2 or 1.0
            for node, (x, y) in points.items():
                share = min(1.0, max(0.0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / square))
                near = math.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)) < _NEAR
                count += near and node not in (link.first, link.second)
    return count


def _draw_side(axes: Axes, description: MachineDescription, links: Sequence[_Link]) -> None:
    # Rows from top to bottom: what turns with the head, the drive, what carries it.
    groups = [_drawn_parts(description, name) for name in SUBSYSTEMS]
    drawn = _drawn([value for parts in groups for part in parts for value in part.x])
    points = _arrange(groups, drawn, links)
    for link in links:
        _draw_link(axes, link, points)
    test_points: dict[int, str] = {}
    for name, place in description.sensor_places.items():
        test_points[place.node] = ", ".join(filter(None, (test_points.get(place.node), name)))
    for parts in groups:
        for part in parts:
            _draw_part(axes, part, points, test_points)
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkB": 7.0}
    loaded = points[description.load_node]
    axes.annotate("loads", loaded, (0, 30), textcoords="offset points", arrowprops=arrow, ha="center", fontsize=8)
    axes.set_xlim(-1.0, _LENGTH + 1.0)
    axes.set_ylim(min(y for _, y in points.values()) - 0.5, 0.7)
    axes.set_xticks(list(drawn.values()), [f"{x + 0.0:g}" for x in drawn], rotation=90, fontsize=7)
    axes.set_yticks([])
    axes.set_xlabel("x, m (gaps drawn as their square root)")
    axes.spines[["left", "right", "top"]].set_visible(False)
    title = f"side view; rows only to tell parts apart; drive 1 stands for all {description.driveshaft.count}"
    axes.set_title(title, loc="left", fontsize=10)


def _draw_part(axes: Axes, part: _DrawnPart, points: Points, test_points: Mapping[int, str]) -> None:
    colour = _COLOURS[part.subsystem]
    if len(part.nodes) > 1:
        x, y = zip(*(points[node] for node in part.nodes), strict=True)
        axes.plot(x, y, color=colour, lw=9, alpha=0.35, solid_capstyle="round", zorder=2)
    for node in part.nodes:
        tested = node in test_points
        marker = "o" if len(part.nodes) > 1 else "s"
        axes.plot(*points[node], marker, ms=14, mfc=_TESTED if tested else "white", mec=colour, mew=1.5, zorder=3)
        axes.text(*points[node], str(node), ha="center", va="center_baseline", fontsize=7, zorder=4)
        if tested:
            label = axes.annotate(test_points[node], points[node], (0, -10), textcoords="offset points", zorder=5)
            label.set(ha="center", va="top", fontsize=8, weight="bold", bbox=_GROUND)


def _draw_link(axes: Axes, link: _Link, points: Points) -> None:
    colour, dashes, _ = _STYLES[link.kind]
    start = points[link.first]
    if link.second is None:
        outward = 0.6 if start[0] > _LENGTH / 2.0 else -0.6
        end = (start[0] + outward, start[1])
        axes.plot(*end, marker="|", ms=22, mew=3.0, color="#555555", zorder=1)
    else:
        end = points[link.second]
    axes.plot((start[0], end[0]), (start[1], end[1]), color=colour, ls=dashes, lw=2.0, zorder=1)
    if link.name:
        # In the first gap between rows: further on, a long line crosses others.
        rows = abs(end[1] - start[1]) / _ROW
        share = 0.5 / max(1.0, rows)
        at = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
        offset, side = ((0, 7), "center") if rows < 0.5 else ((4, 0), "left")
        label = axes.annotate(link.name, at, offset, textcoords="offset points", zorder=5)
        label.set(ha=side, va="center", fontsize=7, bbox=_GROUND)


def _draw_end(axes: Axes, description: MachineDescription) -> None:
    """Draw the ring with its pinions as one sees them looking forward: y to the left, z up."""
    drive = description.driveshaft
    pair = gear_pair(drive)
    ring = pair.driven_pitch_radius
    outside = max(ring, pair.centre_distance + pair.pinion_pitch_radius)
    axes.add_patch(Circle((0.0, 0.0), ring, fill=False, ec=_COLOURS[STRUCTURES[0]], lw=2.0))
    axes.text(0.0, 0.0, f"ring gear\nnode {drive.ring_node}", ha="center", va="center", fontsize=8)
    for i, angle in enumerate(description.drive_angles):
        front, middle, rear, output, rotor = drive_nodes(drive, i)
        _, y, z = drive_positions(drive, i, float(angle))[middle]
        axes.add_patch(Circle((y, z), pair.pinion_pitch_radius, fc="white", ec=_COLOURS["driveshaft"], lw=2.0))
        axes.text(y, z, str(middle), ha="center", va="center_baseline", fontsize=8)
        c, s = math.cos(angle), math.sin(angle)
        side = "center" if abs(c) < 0.05 else ("right" if c > 0.0 else "left")  # of the text; y is to the left
        label = f"drive {i + 1}: {front}–{rear}, {output}, {rotor}"
        axes.text(1.08 * outside * c, 1.08 * outside * s, label, ha=side, va="center", fontsize=7)
    ends = (0.42 * ring, -0.1 * ring), (0.0, 0.42 * ring)
    turn = FancyArrowPatch(*ends, connectionstyle="arc3,rad=-0.4", arrowstyle="-|>", mutation_scale=12, color="black")
    axes.add_patch(turn)
    axes.set_xlim(2.0 * outside, -2.0 * outside)
    axes.set_ylim(-1.15 * outside, 1.15 * outside)
    axes.set_aspect("equal")
    axes.set_xlabel("y, m")
    axes.set_ylabel("z, m")
    axes.spines[["right", "top"]].set_visible(False)
    axes.set_title("drives, looking forward; pitch circles to scale", loc="left", fontsize=10)


def _draw_legend(axes: Axes, kinds: set[str]) -> None:
    axes.axis("off")
    handles: list[Patch | Line2D] = [Patch(color=_COLOURS[name], alpha=0.5, label=_LABELS[name]) for name in SUBSYSTEMS]
    for marker, fill, label in (
        ("o", "white", "node of a shaft"),
        ("s", "white", "rigid body"),
        ("o", _TESTED, "test point"),
    ):
        handles.append(Line2D([], [], color="none", marker=marker, mec="#555555", mfc=fill, ms=10, label=label))
    handles.append(Line2D([], [], color="none", marker="|", mec="#555555", ms=14, mew=3.0, label="ground"))
    for kind, (colour, dashes, label) in _STYLES.items():
        if kind in kinds:
            handles.append(Line2D([], [], color=colour, ls=dashes, lw=2.0, label=label))
    axes.legend(handles=handles, loc="center", ncols=2, frameon=False, fontsize=9, labelspacing=0.9)
