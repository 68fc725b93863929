"""Disc cutters: the force on one, their places, their sum.

Sources: the CSM model's example as handed down with it (R 216 mm, T 15 mm, S 80 mm, p 4 mm, 170 and 11 MPa: 174 kN and
16.9 kN, three figures), its powers by dimension; the sum of the forces one by one with numpy's cross product and
scipy's rotations; spacing by hand.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import head_wrench
from scipy.spatial.transform import Rotation

from tbm_dynamics.loads.cutters.csm import cutting_forces
from tbm_dynamics.loads.cutters.description import CutterError, Disc, Rock
from tbm_dynamics.loads.cutters.head import in_fixed_axes
from tbm_dynamics.loads.cutters.layout import CutterLayout, read_layout

HEAD = 3.965
ROCK = Rock(ucs_mpa=170, bts_mpa=11, source="test")
DISC = Disc(radius=0.216, tip_width=0.015, source="test")


@pytest.fixture(scope="module")
def layout():
    return read_layout("dz101", HEAD)


def test_forces_are_those_of_the_published_example():
    normal, rolling = cutting_forces(ROCK, DISC, [0.08], 0.004)
    assert normal == pytest.approx([174e3], rel=0.003)
    assert rolling == pytest.approx([16.9e3], rel=0.003)


def test_the_resultant_halves_the_arc_of_contact():
    normal, rolling = cutting_forces(ROCK, DISC, [0.08, 0.05], 0.0099)
    assert rolling / normal == pytest.approx(math.tan(math.acos(1.0 - 9.9 / 216.0) / 2.0))


@settings(max_examples=30)
@given(factor=st.floats(0.1, 10.0), penetration=st.floats(1e-4, 0.03))
def test_powers_of_strength_spacing_and_size(factor, penetration):
    def normal(rock=ROCK, disc=DISC, spacing=0.08, depth=penetration):
        return cutting_forces(rock, disc, [spacing], depth)[0][0]

    stronger = ROCK.model_copy(update={"ucs_mpa": 170 * factor})
    tougher = ROCK.model_copy(update={"bts_mpa": 11 * factor})
    assert normal(rock=stronger) == pytest.approx(normal() * factor ** (2 / 3))
    assert normal(rock=tougher) == pytest.approx(normal() * factor ** (1 / 3))
    assert normal(spacing=0.08 * factor) == pytest.approx(normal() * factor ** (1 / 3))
    # Everything twice as large under the same pressure: four times the force.
    large = Disc(radius=0.216 * factor, tip_width=0.015 * factor, source="test")
    assert normal(disc=large, spacing=0.08 * factor, depth=penetration * factor) == pytest.approx(normal() * factor**2)


@settings(max_examples=20)
@given(depths=st.lists(st.floats(0.0, 0.05), min_size=2, max_size=2, unique=True))
def test_deeper_takes_more_force(depths):
    shallow, deep = (np.array(cutting_forces(ROCK, DISC, [0.08], depth)) for depth in sorted(depths))
    assert np.all(shallow <= deep)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cutting_forces(ROCK, DISC, [0.08], -1e-3), "penetration -1 mm a turn, allowed are 0 to 216 mm"),
        (lambda: cutting_forces(ROCK, DISC, [0.08], math.nan), "penetration nan"),
        (lambda: cutting_forces(ROCK, DISC, [0.08, 0.0], 1e-3), "spacing"),
    ],
)
def test_what_cannot_cut_is_refused(make, message):
    with pytest.raises(CutterError, match=message):
        make()


def test_the_shipped_layout_covers_the_face(layout):
    assert [layout.count(kind) for kind in ("centre", "face", "gauge")] == [4, 32, 11]
    assert len(set(layout.cutter.tolist())) == 47
    assert len(layout.radius) == 51  # the centre ones are twins
    assert layout.radius.max() == pytest.approx(HEAD)
    assert np.degrees(layout.tilt.max()) == pytest.approx(70.0)
    # Every strip of rock belongs to one disc: along the flat face the widths add up to its radius.
    flat = layout.tilt == 0.0
    assert layout.spacing[flat][:-1].sum() == pytest.approx(np.sort(layout.radius[flat])[-2] + 0.042, abs=1e-6)
    spacing = {kind: layout.spacing[[each == kind for each in layout.kind]] for kind in ("centre", "face", "gauge")}
    assert np.all((spacing["centre"] >= 0.085) & (spacing["centre"] <= 0.1))
    assert np.all((spacing["face"] >= 0.075) & (spacing["face"] <= 0.0875))
    assert np.all((spacing["gauge"] >= 0.02) & (spacing["gauge"] <= 0.08))


def test_the_sum_of_the_forces_one_by_one(layout):
    random = np.random.default_rng(4)
    forces = random.uniform(1e4, 2e5, (3, 51))
    total = np.zeros(6)
    for radius, angle, tilt, *force in zip(layout.radius, layout.angle, layout.tilt, *forces, strict=True):
        # Built at the top of the y axis, tilted about z, then turned about x.
        place = Rotation.from_euler("x", angle).apply([0.0, radius, 0.0])
        tilted = Rotation.from_euler("z", -tilt)
        axes = [tilted.apply([-1.0, 0.0, 0.0]), [0.0, 0.0, -1.0], tilted.apply([0.0, -1.0, 0.0])]
        # A disc that tilts outwards pushes outwards, so that the rock pushes it inwards.
        axes[0][1], axes[2][0] = -abs(axes[0][1]), abs(axes[2][0])
        push = Rotation.from_euler("x", angle).apply(np.array(force) @ np.array(axes))
        total += np.concatenate([push, np.cross(place, push)])
    assert head_wrench(layout, *forces) == pytest.approx(total, rel=1e-9)


def test_equal_discs_across_the_head_leave_thrust_and_torque():
    ring = CutterLayout(
        np.arange(6), ("gauge",) * 6, np.full(6, 3.0), np.arange(6) * np.pi / 3.0, np.full(6, math.radians(30.0))
    )
    found = head_wrench(ring, 150e3, 20e3)
    expected = [-6 * 150e3 * math.cos(math.radians(30.0)), 0.0, 0.0, -6 * 20e3 * 3.0, 0.0, 0.0]
    assert found == pytest.approx(expected, abs=1e-6)


def test_a_turned_head_turns_its_forces(layout):
    wrench = head_wrench(layout, 150e3, 20e3, 15e3)
    angles = np.linspace(-7.0, 7.0, 15)
    expected = [
        np.concatenate([Rotation.from_euler("x", a).apply(part) for part in (wrench[:3], wrench[3:])]) for a in angles
    ]
    assert in_fixed_axes(wrench, angles) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-6)


GOOD = "cutter,type,radius_m,angle_deg,tilt_deg\n1,centre,0.1,0,0\n2,face,0.2,90,0\n3,gauge,0.3,180,30\n"
WRONG = {
    "outside the head": (
        "3,gauge,0.3",
        "3,gauge,4.2",
        "line 4, column radius_m: 4.2; allowed is a number from 0 to 3.965",
    ),
    "no number": ("0.2,90", "far,90", "line 3, column radius_m: far; allowed"),
    "empty cell": ("0.2,90,0", "0.2,,0", "line 3, column angle_deg: empty; allowed"),
    "not finite": ("0.2,90", "nan,90", "line 3, column radius_m: nan"),
    "missing cell": ("0.2,90,0", "0.2,90", "line 3: 4 cells; must be 5"),
    "type": ("2,face", "2,hob", "line 3, column type: 'hob'; allowed are centre, face, gauge"),
    "cutter": ("2,face", "two,face", "line 3, column cutter: 'two'"),
    "tilt": ("180,30", "180,95", "line 4, column tilt_deg: 95; allowed is a number from 0 to 80"),
    "header": ("radius_m", "radius", "line 1: columns cutter, type, radius,"),
    "on top": (
        "2,face,0.2,90",
        "2,face,0.11,5",
        "lines 2 and 3: discs of cutters 1 and 2 are 14 mm apart; at least 30 mm",
    ),
    "nothing": (GOOD, "# nothing\n", "holds no cutter"),
    "only a header": (GOOD[40:], "", "holds no cutter"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_layout_is_refused_with_line_and_column(tmp_path, name):
    old, new, message = WRONG[name]
    assert old in GOOD
    path = tmp_path / "mine.csv"
    path.write_text(GOOD.replace(old, new, 1), "utf-8")
    with pytest.raises(CutterError) as caught:
        read_layout(path, HEAD)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CutterError, match=r"nowhere\.csv: No such file"):
        read_layout(tmp_path / "nowhere.csv", HEAD)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CutterError, match=r"binary\.csv: no UTF-8 text"):
        read_layout(tmp_path / "binary.csv", HEAD)


def test_comments_and_blank_lines_are_passed_over(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("# mine\n\n" + GOOD.replace("2,face", "# here\n2,face"), "utf-8")
    assert read_layout(path, HEAD).radius == pytest.approx([0.1, 0.2, 0.3])
