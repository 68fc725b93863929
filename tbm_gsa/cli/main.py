"""`tbm-monitor`: registers the commands and turns every expected error into one line and an exit code."""

from __future__ import annotations

import signal
import sys

import click
import typer

from tbm_gsa.cli import compare, demo, doctor, gsa, machine, run, simulate
from tbm_gsa.cli.output import notes

app = typer.Typer(
    name="tbm-monitor",
    help="Drive-train monitor for tunnel boring machines.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(demo.demo)
app.command()(run.run)
app.command()(simulate.simulate)
app.command()(compare.compare)
app.add_typer(gsa.app, name="gsa")
app.add_typer(machine.app, name="machine")
app.command()(doctor.doctor)

BAD_INPUT = 2


def main() -> None:
    """Run the command line; exit code 0 on success, 2 on bad input, 130 after Ctrl-C."""
    # What was started is ended in order, whichever of the two signals comes.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # -c and -m runs have no useful argv[0]; the name users type stands in messages.
    try:
        code = app(prog_name="tbm-monitor", standalone_mode=False)
    except click.exceptions.Exit as leave:
        code = leave.exit_code
    except click.exceptions.Abort:
        code = 130
    except KeyboardInterrupt:
        code = 130
    except click.ClickException as error:
        notes.print(f"tbm-monitor: {error.format_message()}", markup=False, highlight=False)
        code = BAD_INPUT
    except (ValueError, OSError, RuntimeError) as error:
        notes.print(f"tbm-monitor: {' '.join(str(error).split())}", markup=False, highlight=False)
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
