"""Built-in arms: the numbers of makers and of published identifications, one YAML file each, with its sources."""
