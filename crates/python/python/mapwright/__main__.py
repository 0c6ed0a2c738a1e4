"""`python -m mapwright` is the command `mapwright`."""

from . import _command

_command()
