"""Which roads a data set shows, by the estimator ``cv`` on some of its frames."""

import numpy as np

from learning.dataset.dataset import Dataset, Rows
from learning.dataset.route_camera import route_camera
from perception.estimators import Estimator, entry_of
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame

LOOKED_AT = 240  # frames, evenly in time
ESTIMATOR = "cv"
MARKED, EDGES, NEITHER = "lane lines", "edges alone", "neither"


def road_kinds(dataset: Dataset, rows: Rows) -> dict[str, float] | None:
    """Shares of the frames with lane lines, with edges of the road alone, and with neither; None without frames.

    The camera is calibrated by the frames of each route, and every frame is judged on its own.
    """
    if not len(rows):
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, LOOKED_AT).astype(int))]
    counts = dict.fromkeys((MARKED, EDGES, NEITHER), 0)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for route in dict.fromkeys(rows["route"].tolist()):
        of_route = rows[rows["route"] == route]
        camera = route_camera(dataset, of_route)
        for row, image in zip(of_route, dataset.images(of_route), strict=True):
            cv: Estimator = entry_of(ESTIMATOR).build(camera, vehicle, assumed=True)
            found = cv.step(Frame(t_s=float(row["t_s"]), image=image), None, now_s=float(row["t_s"]))
            counts[{True: MARKED, False: EDGES, None: NEITHER}[found.marked]] += 1
    return {kind: count / len(rows) for kind, count in counts.items()}
