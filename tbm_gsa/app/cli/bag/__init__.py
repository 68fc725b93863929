"""`tbm-monitor bag`: one command a file."""

import typer

from tbm_gsa.app.cli.bag import import_, info, play, record, recover

app = typer.Typer(add_completion=False, no_args_is_help=True)
app.command()(info.info)
app.command()(recover.recover)
app.command("import")(import_.import_)
app.command()(play.play)
app.command()(record.record)
