"""Messages do not change after they are made."""

from dataclasses import FrozenInstanceError, fields

import pytest

from trepid.messages import Command, SimTruth


@pytest.mark.parametrize("message_type", [Command, SimTruth])
def test_messages_are_locked(message_type):
    message = message_type(**{f.name: 0.0 for f in fields(message_type)})
    with pytest.raises(FrozenInstanceError):
        message.t_s = 1.0
