"""A world, a robot and a camera that record a log: a folder, or measurements in memory."""

from frontend.simulate.library import load_scenario, scenario_names
from frontend.simulate.noise import NoiseLevel, noisier
from frontend.simulate.record import simulate, simulate_log, simulate_measurements
from frontend.simulate.scenario import Scenario

__all__ = [
    "NoiseLevel",
    "Scenario",
    "load_scenario",
    "noisier",
    "scenario_names",
    "simulate",
    "simulate_log",
    "simulate_measurements",
]
