"""Complete agent that acts on objects seen from three views (docs/tutorials/your-own-agent.md).

helios up --agent helios_examples.careful_agent:agent
"""

from helios_planner.plugins import (
    Agent,
    Decision,
    MapBelief,
    ObjectInstance,
    Phase,
    Places,
    Search,
    SearchTools,
    act_on_best,
    explorer,
)

VIEWS = 3
SAME_M = 0.3  # radius around a failed target in which nothing is tried again


def nearest(places: Places):
    return -places.distance_m


class CarefulSearch(Search):
    def __init__(self, tools: SearchTools, phase: Phase, name: str) -> None:
        super().__init__(tools, phase, name, SAME_M)
        self._explorer = explorer(self, nearest)

    def sure(self) -> list[ObjectInstance]:
        known = self.belief.known(self.name)
        return [o for o in known if self.open(o) and o.views >= VIEWS and o.class_score >= 0.4]

    def decide(self) -> Decision:
        things = self.sure()
        return act_on_best(things, [o.score for o in things], f"seen from {VIEWS} sides")

    def explore(self) -> bool:
        return self._explorer.step(lambda: bool(self.sure()))


agent = Agent(
    belief=MapBelief,
    seek_object=lambda tools, name, start: CarefulSearch(tools, Phase.FIND_OBJECT, name),
    seek_receptacle=lambda tools, name, not_at: CarefulSearch(tools, Phase.FIND_RECEPTACLE, name),
)
