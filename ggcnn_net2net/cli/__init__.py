"""The command line: one thin module a subcommand, imported when it is called."""
