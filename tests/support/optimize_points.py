"""A stand-in for the workers of an optimisation."""


class StandIn:
    """Outcomes of a function of the changes, in any order; a list of what was asked for, and an end after so many."""

    def __init__(self, outcome, order=lambda indices: indices, end=None):
        self.outcome, self.order, self.end, self.asked = outcome, order, end, []

    def __call__(self, changes, accuracy="full"):
        for index in self.order(range(len(changes))):
            if self.end is not None and len(self.asked) > self.end:
                raise KeyboardInterrupt
            self.asked.append(changes[index])
            yield index, self.outcome(changes[index])
