"""Standing vehicles over the markings: parked on the right, queueing on the left."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.roads.disturbance_table import Occlusion, at
from sim_harness.world.roads.disturbances import Disturbance
from sim_harness.world.roads.road import Road

SLOT_M = 9.0
SLOTS_PER_100M = 2 * 100 / SLOT_M
PAINTS_BGR = ((120, 60, 40), (190, 190, 188), (52, 50, 50), (45, 40, 130), (150, 150, 155), (225, 228, 228))
VAN = Body(rear_m=-1.05, front_m=4.25, width_m=2.0, height_m=2.4, waist_m=1.25)
VANS = 0.2  # share


def standing(
    road: Road, disturbance: Disturbance, settings: Occlusion, *, seed: int
) -> Sequence[tuple[Pose, Body]]:
    """World poses and bodies. Higher grades keep the vehicles of lower ones, move them inwards and add more."""
    end_m = min(disturbance.to_m or road.length_m, road.length_m)
    full = at(settings.vehicles_per_100m, disturbance.grade) / SLOTS_PER_100M
    over_m = at(settings.over_line_m, disturbance.grade)
    found = []
    for slot in range(int(disturbance.from_m // SLOT_M), int(end_m // SLOT_M)):
        for side in (-1, 1):
            rng = np.random.default_rng((seed, 41, slot, side + 1))
            chance, along, aside, turn, van = rng.random(5)
            if chance >= full:
                continue
            paint = PAINTS_BGR[int(rng.integers(len(PAINTS_BGR)))]
            body = replace(VAN if van < VANS else Body(), bgr=paint)
            station_m = slot * SLOT_M + 1.2 + 2.0 * along
            out_m = road.width_at(station_m) / 2 + body.width_m / 2 - over_m + 0.12 * aside
            x, y = road.position(station_m, side * out_m)
            found.append(((x, y, road.heading_at(station_m) + 0.04 * (turn - 0.5)), body))
    return found
