"""Links between vehicles that agree on committed plans, as scenarios state them."""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field

from swarmstart.cases.format.parts import NonNegative, Number, Part, Positive
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.ocp import Links


class Silence(Part):
    """Time in which a vehicle neither sends nor hears.

    Attributes:
        vehicle: Number of the vehicle, from 0.
        from_s: Beginning of the silence [s].
        to_s: End of the silence [s]; null means that it does not end.
    """

    vehicle: int = Field(ge=0)
    from_s: NonNegative
    to_s: NonNegative | None = None


class LinksPart(Part):
    """Links: in every tick, a part of a step, each vehicle broadcasts to all others.

    Attributes:
        ticks: Number of ticks, equally long, into which a step is divided.
        most_delay: Number of ticks by which a message can be late: it takes 1 to 1 +
            most_delay ticks.
        loss: Probability that a message is lost, for each receiver.
        silences: Times in which vehicles neither send nor hear.
        range_m: Largest distance between sender and receiver [m]; if it is given,
            vehicles also pass on what they hear, and null means any distance.
    """

    ticks: int = Field(default=2, ge=1, le=100)
    most_delay: int = Field(default=0, ge=0, le=10_000)
    loss: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    silences: list[Silence] = Field(default_factory=list)
    range_m: Positive | None = None

    def links(self) -> Links:
        """Return the links that these keys describe."""
        return Links(
            period=self.ticks,
            most_delay=self.most_delay,
            loss=self.loss,
            silences={
                one.vehicle: (one.from_s, np.inf if one.to_s is None else one.to_s)
                for one in self.silences
            },
            radio_range=np.inf if self.range_m is None else self.range_m,
        )

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if a vehicle has two silences."""
        names = {one.vehicle for one in self.silences}
        if len(names) < len(self.silences):
            yield ("links", "silences"), "expected at most one silence of each vehicle"
