"""Files that describe: scenes and studies."""
