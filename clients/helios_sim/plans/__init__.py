"""Homes that people drew in Sweet Home 3D: `home_of_plan(PlanSource.of(path), seed)` is a `Home`.

`plan_archive` and `plan_xml` read the file safely, `plan_reader` turns one level into a `Plan` in
our units and frame, `plan_builder` builds the home: walls, floors, doors and furniture as drawn,
with household things by seed or by the file beside the plan.
"""

from helios_sim.plans.plan_builder import DrawnHome, drawn_home, home_of_plan
from helios_sim.plans.plan_source import PlanSource

__all__ = ["DrawnHome", "PlanSource", "drawn_home", "home_of_plan"]
