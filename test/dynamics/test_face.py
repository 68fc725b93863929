"""Mixed faces, boulders, worn and lost cutters.

Sources: the forces one by one where the discs are (without fluctuation, so exact), and what turns or stands still: a
lost cutter leaves its force turning with the head, a layer leaves a moment that stands; anything that stands in the
face makes lines at multiples of the rotation frequency only. Discs on an edge between rocks, 0.1 m wide, lie between.
"""

import numpy as np
import pytest
from machine_files import built, head_wrench, plain, with_cutters

from tbm_dynamics import load_machine
from tbm_dynamics.loads.cutters.cutter_loads import CutterLoads
from tbm_dynamics.loads.cutters.description import Boulder, CutterError, Face, Layer
from tbm_dynamics.loads.cutters.head import in_fixed_axes
from tbm_msgs_py.base.errors import MachineError

THRUST, SPEED = 12e6, 0.6


@pytest.fixture(scope="module")
def even():
    """The head of dz101 without fluctuation."""
    head = load_machine("dz101").cutter_loads().head
    still = head.description.fracture.model_copy(update={"heights": (0.0, 0.0)})
    return with_cutters(head, fracture=still, side_share=0.0)


def layer(level, strength):
    return Layer(level=level, strength=strength)


def boulder(y, z, radius, strength):
    return Boulder(y=y, z=z, radius=radius, strength=strength)


def facing(head, *zones, **wear):
    """The head before other rock, with some cutters worn: c7=1.4 is cutter 7."""
    factors = {int(name[1:]): factor for name, factor in wear.items()}
    return with_cutters(head, face=Face(zones=zones, wear=factors, source="test"))


def turns(head, samples=3600):
    """Loads over one turn, (n, 6), and the object."""
    loads = CutterLoads(head, THRUST, SPEED)
    return loads.evaluate(np.arange(samples) * 2.0 * np.pi / SPEED / samples), loads


def normal_and_rolling(loads):
    """Forces (n,) of the discs in even rock, from their axial force and their torque."""
    layout, wrenches = loads.head.layout, loads.head.wrenches(loads.penetration)
    return -wrenches[:, 0] / np.cos(layout.tilt), -wrenches[:, 3] / layout.radius


@pytest.mark.parametrize(
    "zones", [(layer(0.5, 2.0),), (boulder(1.0, -1.5, 0.8, 3.0),), (layer(0.5, 0.4), boulder(0.0, 1.0, 1.0, 2.0))]
)
def test_the_sum_of_the_discs_where_they_are(even, zones):
    loads = CutterLoads(facing(even, *zones), THRUST, SPEED)
    normal, rolling = normal_and_rolling(loads)
    layout = loads.head.layout
    for angle in np.linspace(0.0, 6.0, 7):
        place = layout.radius * np.exp(1j * (layout.angle + angle))
        y, z, factor, sure = place.real, place.imag, np.ones(51), True
        for zone in zones:
            depth = z - zone.level if isinstance(zone, Layer) else zone.radius - np.hypot(y - zone.y, z - zone.z)
            factor = np.where(depth > 0.0, zone.strength, factor)
            sure = sure & (np.abs(depth) > 0.05)
        low, high = (
            in_fixed_axes(head_wrench(layout, normal * f, rolling * f), angle)
            for f in (np.where(sure, factor, 0.0), np.where(sure, 0.0, 1.0))
        )
        found = loads.evaluate([angle / SPEED])[0] + -even.rest
        # Discs on an edge lie between the rocks, of strengths 0.4 to 3 times the even one.
        assert -found[0] >= -(low + 0.4 * high)[0] - 1.0
        assert -found[0] <= -(low + 3.0 * high)[0] + 1.0


def test_the_thrust_is_kept_whatever_the_face(even):
    faces = facing(even, layer(0.0, 3.0)), facing(even, boulder(2.0, 1.0, 0.7, 4.0)), facing(even, c7=1.4, c20=0.0)
    for head in faces:
        values, loads = turns(head)
        assert values[:, 0].mean() == pytest.approx(-THRUST, rel=2e-4)  # edges, at 720 places of a turn
        assert values.mean(axis=0) == pytest.approx(loads.mean, abs=2e-4 * THRUST)


def test_a_lost_cutter_leaves_its_force_turning_with_the_head(even):
    whole, loads = turns(even)
    lost, without = turns(facing(even, c30=0.0))
    spectrum = np.fft.rfft(lost, axis=0) / len(lost)
    # Lateral: the rotation frequency and nothing else.
    lateral = np.abs(spectrum[:, 1])
    assert lateral[1] > 1e6 * np.delete(lateral, 1).max()
    assert np.ptp(lost[:, 0]) < 1e-6 * THRUST
    # The rest presses deeper; what is out of balance is then that of the others.
    force = without.head.wrenches(without.penetration).sum(axis=0)
    assert 2.0 * lateral[1] == pytest.approx(np.hypot(force[1], force[2]), rel=1e-6)
    assert without.penetration > loads.penetration
    assert np.ptp(whole[:, 0]) < 1e-6 * THRUST


def test_a_hard_layer_tilts_the_head_and_stands_still(even):
    values, loads = turns(facing(even, layer(0.0, 2.0)))
    # More push at z > 0: a moment z·F_x about y that stands; two thirds of the force on one side.
    arm = loads.head.layout.radius.mean() * 2.0 / np.pi
    expected = -(THRUST - even.friction) / 3.0 * arm
    assert values[:, 4].mean() == pytest.approx(expected, rel=0.15)
    assert abs(values[:, 5].mean()) < 0.02 * abs(expected)


def test_a_boulder_makes_lines_at_multiples_of_the_rotation(even):
    head = facing(even, boulder(2.0, 1.0, 0.7, 4.0))
    loads = CutterLoads(head, THRUST, SPEED)
    turns, samples = 8, 400
    values = loads.evaluate(np.arange(turns * samples) * 2.0 * np.pi / SPEED / samples)
    power = np.abs(np.fft.rfft(values[:, [0, 3]] - values[:, [0, 3]].mean(axis=0), axis=0)) ** 2
    lines = np.arange(len(power)) % turns == 0
    assert power[~lines].max() < 1e-12 * power[lines].max()
    assert np.count_nonzero(power[lines, 0] > 1e-3 * power[:, 0].max()) > 5


def test_wear_of_a_cutter_that_is_not_there(even):
    with pytest.raises(CutterError, match=r"^face: no cutter 48, there are 1 to 47$"):
        CutterLoads(facing(even, c48=0.0), THRUST, SPEED)


def test_a_face_in_the_machine_file():
    data = plain()
    zones = [{"level": 0.5, "strength": 2.0}, {"y": 1.0, "z": 0.0, "radius": 0.5, "strength": 3.0}]
    data["cutters"]["face"] = {"zones": zones, "wear": {5: 1.2}, "source": "assumed"}
    face = built(data).cutter_loads().head.face
    assert face == Face(zones=(layer(0.5, 2.0), boulder(1.0, 0.0, 0.5, 3.0)), wear={5: 1.2}, source="assumed")
    data["cutters"]["face"]["wear"] = {60: 0.0}
    with pytest.raises(MachineError, match=r"^dz101: cutters: face: no cutter 60"):
        built(data).cutter_loads()
