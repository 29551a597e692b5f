"""The `semsfm` command: one thin module per subcommand."""
