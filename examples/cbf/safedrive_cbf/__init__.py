"""A method, a guard and a scenario for safedrive-bench, from outside."""
