"""The cutter level of the loads: discs on the head, the rock's forces on each, their sum."""

from tbm_dynamics.loads.cutters.csm import Disc, Rock, cutting_forces
from tbm_dynamics.loads.cutters.cutter_loads import Cutterhead, CutterLoads
from tbm_dynamics.loads.cutters.errors import CutterError
from tbm_dynamics.loads.cutters.face import Boulder, Face, Layer
from tbm_dynamics.loads.cutters.fracture import Fracture
from tbm_dynamics.loads.cutters.head import head_wrench, turned
from tbm_dynamics.loads.cutters.layout import CutterLayout, read_layout

__all__ = [
    "Boulder",
    "CutterError",
    "CutterLayout",
    "CutterLoads",
    "Cutterhead",
    "Disc",
    "Face",
    "Fracture",
    "Layer",
    "Rock",
    "cutting_forces",
    "head_wrench",
    "read_layout",
    "turned",
]
