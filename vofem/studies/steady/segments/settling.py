"""Bodies that bounce ever lower on a rigid stop until they rest there.

With a restitution above zero the bounces become infinitely many. In an orbit the body comes to rest in the first impact
that is slower than a share s of the fastest one on its stop. All that the later bounces would do differs from that by
the square of s: their impulses are those of this impact and of the reaction at rest, and their heights are as small.

A. Nordmark, P. Piiroinen, Nonlinear Dynamics 58, 2009, 85-106; H. Dankowicz, E. Fotsch, Procedia IUTAM 20, 2017, 18-25.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vofem.integrators.event_driven.flow import Flow, FlowEvent
from vofem.system import OPEN, PINNED

#: Speed of an impact, over the largest one on its stop, below which the body comes to rest in it.
SETTLES = 1e-5


def bounces(changes: Sequence[tuple[int, int, int]]) -> set[int]:
    """Return the numbers of the impacts after which a body bounces until it rests, among changes in the order of time.

    These are given by contacts and their statuses before and after, which are both open at an impact.
    """
    found, rests = set[int](), set[int]()
    for k in range(len(changes) - 1, -1, -1):
        contact, before, after = changes[k]
        if before != OPEN:
            rests.discard(contact)
        elif after == PINNED:
            rests.add(contact)
        elif after == OPEN and contact in rests:
            found.add(k)
        else:
            rests.discard(contact)
    return found


def bounces_of(events: Sequence[FlowEvent]) -> set[int]:
    """Return the numbers of the impacts among events after which a body bounces until it rests."""
    return bounces([(e.contact, e.before, e.after) for e in events])


def settled(flow: Flow) -> list[FlowEvent]:
    """Return the events of a flow in which bodies come to rest in the first impact that is slow enough."""
    found, before, largest, resting = list[FlowEvent](), bounces_of(flow.events), dict[int, float](), set[int]()
    for e in flow.events:
        if e.before == e.after:
            largest[e.contact] = max(largest.get(e.contact, 0.0), e.rate)
    for k, e in enumerate(flow.events):
        if e.contact in resting:
            # It rests from an earlier impact on.
            if e.after == PINNED:
                resting.remove(e.contact)
        elif k in before and e.rate <= SETTLES * largest[e.contact]:
            found.append(replace(e, after=PINNED))
            resting.add(e.contact)
        else:
            found.append(e)
    return found
