"""Programs that run next to an exported law, without slidax: they are copied into the exported project."""
