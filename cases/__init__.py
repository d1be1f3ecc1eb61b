"""The shipped case files, as package data."""
