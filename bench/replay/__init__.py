"""Recorded episodes, driven again bit for bit: found, checked against their record, drawn."""
