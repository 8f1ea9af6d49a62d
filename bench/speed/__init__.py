"""What ``bench speed`` measures, one module for each command."""
