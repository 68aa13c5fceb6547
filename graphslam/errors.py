"""Exceptions of the project: every message says what was found, where, and what to do next."""


class GraphSlamError(Exception):
    """Base of all errors that a user can cause and can mend."""


class BadLog(GraphSlamError):
    """A recording cannot be used as it is; the message names file, place and cure."""


class BadConfig(GraphSlamError):
    """A configuration value or a combination of options cannot be used."""


class BadMeasurements(GraphSlamError):
    """Measurements or estimates whose shapes, values or order contradict the contract."""


class UnderConstrained(GraphSlamError):
    """The measurements do not determine what was asked for."""
