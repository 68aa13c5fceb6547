"""A world, a robot and a camera that record a log folder."""

from frontend.simulate.library import load_scenario, scenario_names
from frontend.simulate.record import simulate
from frontend.simulate.scenario import Scenario

__all__ = ["Scenario", "load_scenario", "scenario_names", "simulate"]
