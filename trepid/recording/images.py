"""What estimators need of a recording: the settings of its car, and its camera images, one after the other."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from trepid.config import InputError, car_folder, using_car
from trepid.images.files import decoded_image
from trepid.messages import CompressedFrame, Frame
from trepid.recording.foreign import messages_of, types_of
from trepid.recording.reader import RecordingContent
from trepid.recording.scan import Damage, leave_out
from trepid.recording.writer import CAR_FILES
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE, Topic
from trepid.types import Image
from trepid.wire import WireError, from_cdr, ros_name

ImageTopic = Topic[Frame] | Topic[CompressedFrame]


@dataclass(frozen=True, slots=True)
class RecordedImages:
    """The images on one topic of the recording at ``path``."""

    path: Path
    topic: ImageTopic

    def messages(self, damage: Damage | None = None) -> Iterator[tuple[float, Frame | CompressedFrame]]:
        """Arrival [s] and message in the order of the file; those that were malformed on the bus are left out.

        Corrupted parts are left out and reported to ``damage``, by default said once.
        """
        for at_s, data in messages_of(self.path, f"/{self.topic.key}", damage=damage):
            try:
                message: Frame | CompressedFrame = from_cdr(data, self.topic.type)
            except WireError:
                continue  # no node got it
            yield at_s, message

    def count(self) -> int:
        """Number of messages in whole chunks, malformed ones included."""
        return sum(1 for _ in messages_of(self.path, f"/{self.topic.key}", damage=leave_out))


def recorded_images(path: Path) -> RecordedImages | None:
    """The raw images of a recording, else the compressed ones; None without any.

    Raises InputError when ``path`` is no recording, or holds something else on these topics.
    """
    types = types_of(path)
    for topic in (CAMERA_IMAGE, CAMERA_COMPRESSED):
        held, wanted = types.get(f"/{topic.key}"), ros_name(topic.type)
        if held == wanted:
            return RecordedImages(path, topic)
        if held is not None:
            raise InputError(f"{path}: {topic.key} holds {held}, expected {wanted}")
    return None


def decode_image(message: Frame | CompressedFrame) -> Image | None:
    """The image of a message; None for a JPEG that cannot be decoded."""
    if isinstance(message, Frame):
        return message.image
    return decoded_image(message.jpeg)


@contextmanager
def recorded_car(recorded: RecordingContent) -> Iterator[None]:
    """Use the settings of the recorded car, unless another car is in use already. Raises InputError."""
    if car_folder() is not None or not any(name.startswith(CAR_FILES) for name in recorded.files):
        yield
        return
    with recorded_settings(recorded):
        yield


@contextmanager
def recorded_settings(recorded: RecordingContent, *names: str) -> Iterator[None]:
    """Use the recorded files of the car, those called ``names`` or all, in place of any car in use.

    Raises InputError; a fault in one of the files is placed in the recording, as they are gone afterwards.
    """
    with TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        for name, data in recorded.files.items():
            if name.startswith(CAR_FILES) and (not names or name.removeprefix(CAR_FILES) in names):
                (folder / Path(name).name).write_bytes(data)
        try:
            with using_car(folder):
                yield
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", f"{recorded.path}: {CAR_FILES}")) from error
