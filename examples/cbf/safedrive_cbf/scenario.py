"""A scenario from outside: more traffic, pedestrians, a start from rest."""

from typing import Final

from envs.scenario import PedestrianRule, Scenario

RUSH_HOUR: Final = Scenario("rush-hour", vehicles=9, pedestrian_rule=PedestrianRule.FAIR, standing_start=True)
