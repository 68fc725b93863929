"""Print the lowest version of every dependency that setup.py allows, as constraints of pip."""

import ast
import sys
from pathlib import Path

tree = ast.parse((Path(__file__).parents[1] / "setup.py").read_text(encoding="utf-8"))
for statement in tree.body:
    match statement:
        case ast.Assign(targets=[ast.Name("REQUIRED" | "CLUSTER" | "IMPORT" | "LIVE")], value=stated):
            sys.stdout.writelines(f"{bound.replace('>=', '==')}\n" for bound in ast.literal_eval(stated))
