"""A machine is given in one way: `--machine`, a name or a file, in every command that needs one."""

import typer

from tbm_gsa.app.cli.main import app
from tbm_gsa.app.cli.output import DEFAULT_MACHINE

NEED_ONE = {"demo", "run", "simulate", "compare", "gsa run", "reproduce"}
NEED_ONE |= {f"machine {verb}" for verb in ("show", "check", "loads", "update")}


def _parameters(group, path=""):
    """Names of the commands outside `history`, each with its parameter of a machine."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from () if name == "history" else _parameters(command, f"{path}{name} ")
        for parameter in command.params:
            if "machine" in parameter.name:
                yield f"{path}{name}", parameter


def test_every_command_takes_a_machine_alike():
    found = {name: parameter for name, parameter in _parameters(typer.main.get_command(app)) if "history" not in name}
    assert set(found) == NEED_ONE
    alike = {(*one.opts, one.param_type_name, one.default, one.help, one.metavar) for one in found.values()}
    assert alike == {
        ("--machine", "option", DEFAULT_MACHINE, "Name of `machine list`, or path of a machine file.", "<name|file>")
    }


def test_the_earlier_spelling_of_a_machine_still_works(command):
    code, out, err = command("machine", "check", "open380")
    assert code == 0, err
    assert out == command("machine", "check", "--machine", "open380")[1]
