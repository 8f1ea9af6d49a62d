"""The methods: each one file that keeps the contract in method.py."""
