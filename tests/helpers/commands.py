"""All commands of the command line, imported; `gtmbench` itself imports the one that is run."""

from gtmbench.cli.app import app

COMMANDS = {name: app.get_command(None, name) for name in app.list_commands(None)}
