"""Commands, called as a user would."""

from click.testing import CliRunner


def call(command, *arguments):
    """What a command prints; its errors are raised."""
    result = CliRunner().invoke(command, [str(part) for part in arguments], standalone_mode=False)
    if result.exception:
        raise result.exception
    return result.output
