"""What the ``skmotionseg`` command does, a module per subcommand."""
