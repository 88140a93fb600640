"""The settings of the car that a recording holds."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from trepid.config import car_folder, using_car
from trepid.recording.reader import RecordingContent
from trepid.recording.writer import CAR_FILES


@contextmanager
def recorded_car(recorded: RecordingContent) -> Iterator[None]:
    """Use the settings of the recorded car, unless another car is in use already. Raises InputError."""
    own = {name: data for name, data in recorded.files.items() if name.startswith(CAR_FILES)}
    if car_folder() is not None or not own:
        yield
        return
    with TemporaryDirectory() as folder:
        for name, data in own.items():
            (Path(folder) / Path(name).name).write_bytes(data)
        with using_car(Path(folder)):
            yield
