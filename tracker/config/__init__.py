"""Files that people write (scenarios, recipes): YAML read strictly, sections that know their keys, errors that help."""
