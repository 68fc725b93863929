"""The assembled dz101, bare: against the numbers of its file, the motions a mechanism must allow, and statics by hand.

Sources: the file read by PyYAML alone, rigid-body kinematics, the ratio of the teeth, equilibrium of forces. A motion
that strains nothing is held to rounding of the stiffest element (1e-10 of its force); statics to 1e-6, which is what
the conditioning of K (1e10) leaves of 16 digits.
"""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import all_connections, bare, built, plain, stage_of, static_mesh_force, without

from tbm_dynamics import MachineError
from tbm_dynamics.loads.description import COMPONENTS
from tbm_dynamics.mesh.planetary import stage_law
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.system import DIRECTIONS

AXES = ("ux", "uy", "uz")


@pytest.fixture(scope="module")
def data():
    return bare(plain())


@pytest.fixture(scope="module")
def machine(data):
    return built(data)


@pytest.fixture(scope="module")
def system(machine):
    return machine.assemble()


@pytest.fixture(scope="module")
def ratio(data):
    """Of the gearbox."""
    stages = data["driveshaft"]["gearbox"]["stages"]
    return np.prod([1.0 + stage["ring_teeth"] / stage["sun_teeth"] for stage in stages])


@pytest.fixture(scope="module")
def positions(machine):
    return node_positions(machine.description)


@pytest.fixture(scope="module")
def free_stiffness(system, data):
    """K without the springs to the rock."""
    K = system.K.copy()
    for connection in all_connections(data):
        node, other = connection["between"]
        if other == "ground":
            dofs = [system.dof(node, direction) for direction in DIRECTIONS]
            K[dofs, dofs] -= connection["stiffness"]
    return K


@pytest.fixture(scope="module")
def rigid_motion(system, positions, ratio):
    """Everything moves as one body; the angle of a rotor is that over the ratio of its gearbox."""

    def motion(translation, rotation):
        parts = [[*(translation + np.cross(rotation, positions[node])), *rotation] for node in system.nodes]
        whole = np.concatenate(parts)
        whole[[system.dof(node, "rx") for node in range(52, 71, 2)]] /= ratio
        return whole

    return motion


def gear_turn(system, data):
    """The cutterhead side turns by one, every drive by the ratio of the teeth, everything else stands."""
    gear = data["driveshaft"]["gear"]
    motion = np.zeros(system.size)
    for node in range(1, 10):
        motion[system.dof(node, "rx")] = 1.0
    for node in (*range(13, 43), *range(51, 71)):
        motion[system.dof(node, "rx")] = gear["ring_teeth"] / gear["pinion_teeth"]
    return motion


def test_matrices_are_symmetric_and_definite(system):
    assert system.nodes == tuple(range(1, 71))
    for matrix in (system.M, system.C, system.K):
        assert matrix.shape == (420, 420)
        assert np.abs(matrix - matrix.T).max() <= 1e-15 * np.abs(matrix).max()
    np.linalg.cholesky(system.M)
    np.linalg.cholesky(system.K)
    assert np.linalg.eigvalsh(system.C)[0] > -1e-9 * np.abs(system.C).max()


def test_mass_and_its_centre_are_those_of_the_file(system, data, rigid_motion):
    bodies = []  # (mass, x)
    for name in ("cutterhead_bearing_gear", "carrier_girder"):
        group = data[name]
        bodies += [(body["mass"], group["nodes"][body["node"]][0]) for body in group.get("bodies", [])]
        for shaft in group["shafts"]:
            ends = [group["nodes"][shaft["nodes"][end]][0] for end in (0, -1)]
            bodies.append((shaft["mass"], sum(ends) / 2.0))
    drive, x = data["driveshaft"], data["driveshaft"]["placement"]
    one = [
        (drive["pinion_shaft"]["mass"], (x["front_seat"] + x["rear_seat"]) / 2.0),
        (drive["gearbox_output"]["mass"], x["gearbox"]),
        (drive["rotor"]["mass"], x["rotor"]),
    ]
    bodies += one * drive["count"]
    mass = sum(m for m, _ in bodies)
    moment = sum(m * at for m, at in bodies)
    for axis in np.eye(3):
        motion = rigid_motion(axis, np.zeros(3))
        assert motion @ system.M @ motion == pytest.approx(mass, rel=1e-12)
    about_y = rigid_motion(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    up = rigid_motion(np.array([0.0, 0.0, 1.0]), np.zeros(3))
    assert up @ system.M @ about_y == pytest.approx(-moment, rel=1e-9)  # a turn about +y lowers what is ahead


units = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


@settings(max_examples=25)
@given(translation=units, rotation=units)
def test_without_rock_a_rigid_motion_strains_nothing(system, free_stiffness, rigid_motion, translation, rotation):
    motion = rigid_motion(translation, rotation)
    assert np.abs(free_stiffness @ motion).max() <= 1e-11 * np.abs(system.K).max()


def test_without_rock_the_drive_train_turns_freely(system, data, free_stiffness):
    force = np.abs(free_stiffness @ gear_turn(system, data)).max()
    assert force <= 1e-10 * np.abs(free_stiffness).max()
    backwards = gear_turn(system, data)
    backwards[system.dof(14, "rx")] *= -1.0
    assert np.abs(free_stiffness @ backwards).max() > 1e6


def test_without_rock_there_are_just_seven_zero_energy_modes(system, data, free_stiffness, rigid_motion):
    values, shapes = scipy.linalg.eigh(free_stiffness, system.M)
    assert np.abs(values[:7]).max() < 1.0  # rad²/s²: rounding of 1e11
    assert values[7] > 1e2
    motions = [rigid_motion(*pair) for pair in [(e, 0 * e) for e in np.eye(3)]]
    motions += [rigid_motion(0 * e, e) for e in np.eye(3)]
    motions.append(gear_turn(system, data))
    for motion in motions:
        share = shapes[:, :7].T @ system.M @ motion
        assert share @ share == pytest.approx(motion @ system.M @ motion, rel=1e-6)


def test_every_mesh_carries_its_share_on_the_drive_flank(machine, system):
    still = system.equilibrium()
    share = static_mesh_force(machine)
    assert share == pytest.approx(3.04e6 / (10 * 1.5153), rel=1e-3)  # base radius 1.672 m × cos 25°
    assert still.force[:10] == pytest.approx(np.full(10, share), rel=1e-6)


def test_the_teeth_bend_by_hand(machine, system):
    deflection = system.couplings.rows[:10] @ system.equilibrium().displacement
    expected = 150e-6 + static_mesh_force(machine) / 8.1e9
    assert deflection == pytest.approx(np.full(10, expected), rel=1e-6)


def test_rock_and_gripper_take_the_loads(system, data):
    q = system.equilibrium().displacement
    loads = {name: data["loads"][name]["mean"] for name in COMPONENTS}
    grounded = {c["between"][0]: c["stiffness"] for c in all_connections(data) if c["between"][1] == "ground"}
    reaction = {node: -np.array(k) * [q[system.dof(node, d)] for d in DIRECTIONS] for node, k in grounded.items()}
    total = sum(reaction.values())
    for i, name in enumerate(("fx", "fy", "fz")):
        assert total[i] == pytest.approx(-loads[name], rel=1e-6)
    # The motors turn the head, so the rock's torsion spring has nothing to do; the gripper holds it all.
    assert abs(reaction[1][3]) < 1e-6 * abs(loads["mx"])
    assert reaction[50][3] == pytest.approx(-loads["mx"], rel=1e-6)
    # Moments about node 1 from the gripper's forces, 16 m behind.
    assert total[4] + 16.0 * reaction[50][2] == pytest.approx(-loads["my"], rel=1e-5)
    assert total[5] - 16.0 * reaction[50][1] == pytest.approx(-loads["mz"], rel=1e-5)


def test_axial_shortening_by_hand(system, data):
    # Springs side by side: the rock in front, and behind it the chain to the gripper, held by the rock there.
    q = system.equilibrium().displacement
    front, back = q[system.dof(1, "ux")], q[system.dof(50, "ux")]
    assert 1e9 * front + 1e10 * back == pytest.approx(-1.2e7, rel=1e-6)
    E, steel = 210e9, 0.0
    shafts = [*data["cutterhead_bearing_gear"]["shafts"], *data["carrier_girder"]["shafts"]]
    for length, shaft in zip((1.8, 0.4, 0.6, 0.8, 12.0), shafts, strict=True):
        steel += length / (E * np.pi / 4.0 * (shaft["outer_diameter"] ** 2 - shaft["inner_diameter"] ** 2))
    chain = steel + 6.0 / 1e10  # 4–5, 6–7, 9–10, 10–11, 12–44, 49–50
    # The pinions bridge the main bearing a little along their seats (spur teeth slide along x): nothing axial.
    assert front - back == pytest.approx(1e10 * back * chain, rel=1e-6)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), size=st.floats(0.0, 4e-4))
def test_equilibrium_satisfies_the_law_of_the_teeth(system, seed, size):
    # Residual of the equations as the design states them, backlash, open meshes and gearboxes included.
    couplings, random = system.couplings, np.random.default_rng(seed)
    k = couplings.stiffness * random.uniform(0.7, 1.3, 20)
    e = size * random.standard_normal(20) * np.repeat([1.0, 0.5], 10)
    still = system.equilibrium(k, e)
    deflection = couplings.rows @ still.displacement + e
    gap = couplings.half_gap
    assert np.array_equal(gap, np.repeat([150e-6, 0.0], 10))
    force = k * np.where(deflection > gap, deflection - gap, np.where(deflection < -gap, deflection + gap, 0.0))
    assert still.force == pytest.approx(force, abs=1e-3)
    residual = system.mean_force() - uncoupled(system) @ still.displacement - couplings.rows.T @ force
    assert np.abs(residual).max() < 1e-6 * 1.2e7


def test_a_machine_without_rock_floats_as_a_whole(data):
    with pytest.raises(MachineError) as caught:
        built(without(data, ("k_r_ct", 1), ("k_r_gd", 50))).assemble()
    named = ", ".join(map(str, range(1, 71)))
    expected = f"dz101: 7 zero-energy mode(s): nodes {named} float; connect them to the rest or to the ground"
    assert str(caught.value) == expected


def test_a_shield_without_its_cylinders_floats_alone(data):
    with pytest.raises(MachineError, match=r"^dz101: 6 zero-energy mode.*: nodes 43 float; connect"):
        built(without(data, ("k_h_gd", 11))).assemble()


def test_a_node_without_mass_is_named(data):
    data = {**data, "carrier_girder": {**data["carrier_girder"], "bodies": data["carrier_girder"]["bodies"][:2]}}
    with pytest.raises(MachineError, match=r"^dz101: node 50 has no mass"):
        built(data).assemble()


def uncoupled(system):
    """K without meshes and gearboxes."""
    rows = system.couplings.rows
    return system.K - rows.T @ (system.couplings.stiffness[:, None] * rows)


def damping_of(data, **changes):
    system = built({**data, **changes}).assemble()
    rows = system.couplings.rows
    return system, system.C - rows.T @ (system.couplings.damping[:, None] * rows)


ALL = dict.fromkeys(("rock", "bolt", "bearing", "spline", "hydraulic"), 5e-3)


def test_proportional_damping_is_a_time_of_the_stiffness(data):
    steel = {**data["steel"], "damping": 5e-3}
    every = {**ALL, "source": "assumed"}
    system, C = damping_of(data, steel=steel, connection_damping=every)
    assert np.abs(C - 5e-3 * uncoupled(system)).max() <= 1e-12 * np.abs(C).max()


def test_a_ratio_is_that_of_a_mode_at_the_frequency(data):
    # For C = βK alone the modal ratio is φᵀCφ/2ω; read at 40 Hz it is ζ f/40 in a mode at f.
    steel = {**data["steel"], "damping": 5e-3}
    reading = {"reading": "ratio", "frequency": 40.0}
    system, C = damping_of(data, steel=steel, connection_damping={**ALL, "source": "assumed"}, damping=reading)
    squares, shapes = scipy.linalg.eigh(uncoupled(system), system.M)
    kept = slice(20, 50)  # above the free turns of pinions and rotors, whose meshes and gearboxes are taken away
    ratios = np.einsum("in,ij,jn->n", shapes, C, shapes)[kept] / (2.0 * np.sqrt(squares[kept]))
    assert ratios == pytest.approx(5e-3 * np.sqrt(squares[kept]) / (2.0 * np.pi * 40.0), rel=1e-6)


def test_each_type_damps_its_own_connections(data):
    none = {**dict.fromkeys(ALL, 0.0), "source": "assumed"}
    steel = {**data["steel"], "damping": 0.0}
    ends = {"rock": {1, 50}, "bolt": {4, 5, 6, 7, 10, 11, 12, 44}, "hydraulic": {11, 43, 49, 50}}
    ends["bearing"] = {9, 10, 12} | {13 + 3 * i + j for i in range(10) for j in (0, 2)}
    ends["spline"] = {15 + 3 * i for i in range(10)} | {51 + 2 * i for i in range(10)}
    for kind, expected in ends.items():
        system, C = damping_of(data, steel=steel, connection_damping={**none, kind: 1e-3})
        touched = np.abs(C).reshape(70, 6, 420).max(axis=(1, 2)) > 1.0
        assert {node for node, hit in zip(system.nodes, touched, strict=True) if hit} == expected, kind


def test_mesh_damping_is_a_ratio_of_pinion_and_ring(system, data):
    # c = 2ζ√(k m_e) with the polar inertias of a solid pinion shaft and of the ring's tube.
    tube = data["cutterhead_bearing_gear"]["shafts"][2]
    ring = tube["mass"] / 8 * (tube["outer_diameter"] ** 2 + tube["inner_diameter"] ** 2)
    pinion = 550.0 / 8 * 0.30**2
    base = np.cos(np.radians(25.0)) * 0.022 / 2.0
    mass = 1.0 / ((base * 16) ** 2 / pinion + (base * 152) ** 2 / ring)
    assert system.couplings.damping[:10] == pytest.approx(np.full(10, 2 * 0.05 * np.sqrt(8.1e9 * mass)), rel=1e-9)


def stage_compliances(data):
    """Of the stages of a gearbox as they are felt at the pinion shaft, rad/(N·m)."""
    found, speed = [], 1.0
    for stage in data["driveshaft"]["gearbox"]["stages"]:
        teeth = stage["sun_teeth"], stage["planet_teeth"], stage["planets"]
        gears = stage_of(*teeth, module=stage["module"], width=stage["face_width"])
        found.append(stage_law(gears, 210e9, 0.3, 4).compliance[0] / speed**2)
        speed *= 1.0 + stage["ring_teeth"] / stage["sun_teeth"]
    return found


def test_the_gearbox_loses_what_its_springs_lose_in_series(system, data, ratio):
    # Kelvin elements in series, each a spring with its damper: impedance of the whole at a frequency near 0.
    drive = data["driveshaft"]
    rotor, output = drive["rotor"]["inertia"][0] * ratio**2, drive["gearbox_output"]["inertia"][0]
    shaft, stages = drive["gearbox"]["shaft_stiffness"], 1.0 / sum(stage_compliances(data))
    teeth = 2.0 * drive["mesh"]["damping_ratio"] * np.sqrt(stages * rotor * output / (rotor + output))
    omega = 1e-3
    parts = [shaft + 1j * omega * data["steel"]["damping"] * shaft, stages + 1j * omega * teeth]
    whole = 1.0 / sum(1.0 / part for part in parts)
    assert system.couplings.stiffness[10:] == pytest.approx(np.full(10, whole.real))
    assert system.couplings.damping[10:] == pytest.approx(np.full(10, whole.imag / omega))


def test_the_damping_of_the_stages_is_a_ratio_of_their_mode(data):
    # Two inertias on a spring: the decay of their one mode, from a gearbox whose shaft neither gives nor damps.
    stiff = bare(data)
    stiff["driveshaft"]["gearbox"]["shaft_stiffness"] = 1e16
    stiff["steel"]["damping"] = 0.0
    machine = built(stiff)
    couplings, drive = machine.assemble().couplings, machine.description.driveshaft
    inertia = np.diag([drive.rotor.inertia[0] * drive.gearbox.ratio**2, drive.gearbox_output.inertia[0]])
    twist = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K, C = (np.linalg.solve(inertia, part[10] * twist) for part in (couplings.stiffness, couplings.damping))
    roots = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]]))
    swinging = roots[np.abs(roots.imag) > 1.0]
    assert -swinging.real / np.abs(swinging) == pytest.approx(np.full(2, drive.mesh.damping_ratio), rel=1e-6)


def test_the_chain_behind_a_pinion_twists_by_hand(system, data, ratio):
    # Motor torque over each spring in series: spline, shaft and stages of the gearbox; half the pinion shaft.
    drive = data["driveshaft"]
    torque = 3.04e6 * 16 / 152 / 10
    q = system.equilibrium().displacement
    rear, output, rotor, mount = (q[system.dof(node, "rx")] for node in (15, 51, 52, 12))
    assert output - rear == pytest.approx(torque / drive["spline"]["stiffness"][3], rel=1e-6)
    compliance = 1.0 / drive["gearbox"]["shaft_stiffness"] + sum(stage_compliances(data))
    # The ring of a gearbox is part of the mount: relative to it the rotor turns by the ratio, an angle of the motor.
    assert (ratio * rotor - mount) / ratio - (output - mount) == pytest.approx(torque * compliance, rel=1e-6)
    mesh = q[system.dof(14, "rx")]
    G, polar = 210e9 / 2.6, np.pi / 32 * 0.30**4
    assert rear - mesh == pytest.approx(torque * 0.35 / (G * polar), rel=1e-6)


def test_rotors_turn_with_the_ratio_squared(system, data, ratio):
    # Kinetic energy at the motor's speed.
    motion = np.zeros(system.size)
    motion[system.dof(52, "rx")] = 1.0
    assert motion @ system.M @ motion == pytest.approx(data["driveshaft"]["rotor"]["inertia"][0] * ratio**2)


def test_a_drive_turned_to_its_place_is_the_drive_built_there(machine, system, data):
    # Pinion bearing of the fourth drive: six springs along global axes, alike across, so the same in any axes.
    drive, place = data["driveshaft"], node_positions(machine.description)
    node, mount = 13 + 3 * 3, 12
    arm = place[node] - place[mount]
    rigid = np.eye(6)
    rigid[:3, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
    rows, columns = (range(system.dof(n, "ux"), system.dof(n, "ux") + 6) for n in (node, mount))
    expected = -np.diag(drive["pinion_bearing"]["stiffness"]) @ rigid
    assert system.K[np.ix_(rows, columns)] == pytest.approx(expected, abs=1e-5 * 1e10)


def test_stiffness_of_a_drive_is_radial_and_tangential():
    data = plain()
    data["driveshaft"]["pinion_bearing"]["stiffness"] = [1e10, 1e9, 3e9, 0.0, 1e10, 1e10]
    system, angle = built(data).assemble(), 2.0 * np.pi * 3 / 10
    y, z = (system.dof(22, direction) for direction in ("uy", "uz"))
    mount = [system.dof(12, direction) for direction in ("uy", "uz")]
    radial, tangential = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    between = -system.K[np.ix_([y, z], mount)]
    assert between @ radial == pytest.approx(1e9 * radial, abs=1.0)
    assert between @ tangential == pytest.approx(3e9 * tangential, abs=1.0)


def test_unknown_node_and_direction(system):
    assert system.dof(1, "ux") == 0
    assert system.dof(70, "rz") == 419
    with pytest.raises(MachineError, match="node 71: unknown; the system has 70 nodes, 1 to 70"):
        system.dof(71, "ux")
    with pytest.raises(MachineError, match="direction 'x': allowed are ux, uy"):
        system.dof(1, "x")


def test_natural_frequencies_solve_the_eigenproblem(system):
    # scipy's inverse-iteration Lanczos instead of LAPACK's dense solver.
    import scipy.sparse.linalg

    start = np.ones(system.size)
    values = scipy.sparse.linalg.eigsh(system.K, k=12, M=system.M, sigma=0.0, v0=start, return_eigenvectors=False)
    assert system.natural_frequencies(12) == pytest.approx(np.sqrt(np.sort(values)) / (2 * np.pi), rel=1e-6)
