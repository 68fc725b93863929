"""Settings of the player and the recorder."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from tbm_msgs_py.nodes.parameters import Names, SummarySettings, WritingSettings, live_parameter, parameter


class PlayerSettings(SummarySettings):
    """Parameters of `bag_player`."""

    bag: str = parameter("", "rosbag2 folder or bare .mcap file")
    rate: float = live_parameter(1.0, "playing speed, times real time", low=0.1, high=10.0)
    paused: bool = live_parameter(False, "stand still, the clock too")
    loop: bool = parameter(False, "start again at the end")
    start: float = parameter(0.0, "offset of the first message played, s", low=0.0)
    duration: float = parameter(0.0, "recorded time played, s; 0 for all", low=0.0)
    clock: bool = parameter(True, "publish /clock with the recorded time")
    topics: Names = parameter((), "topics played; empty for all")
    wait_for_subscribers: int = parameter(
        1, "subscriptions to the played topics before the first message", low=0, high=1000
    )
    wait_timeout: float = parameter(5.0, "longest wait for these subscriptions, s", low=0.0, high=3600.0)
    exit_at_end: bool = parameter(True, "end the process after the last message")


class RecorderSettings(SummarySettings, WritingSettings):
    """Parameters of `bag_recorder`."""

    output: str = parameter("", "new rosbag2 folder", written=True)
    topics: Names = parameter((), "topics recorded, relative to the namespace or absolute; at least one")
    duration: float = parameter(0.0, "s after which the recording ends; 0 for never", low=0.0)
    flush_period: float = parameter(0.5, "longest time a message stays unwritten, s", low=0.05, high=0.5)
    compression: Literal["none", "zstd"] = parameter("none", "compression of the chunks")
    split_size: float = parameter(0.0, "MB after which the recording goes on in a further file; 0 for never", low=0.0)
    split_time: float = parameter(0.0, "s after which the recording goes on in a further file; 0 for never", low=0.0)
    quota: float = parameter(
        0.0,
        "MB that the output and what was recorded beside it with a quota take at most, the oldest files go; 0 for all",
        low=0.0,
    )

    @model_validator(mode="after")
    def _check_quota(self) -> Self:
        if 0 < self.quota < 2 * self.split_size:
            raise ValueError(
                f"parameter quota: {self.quota:g} MB, allowed: 0 or at least twice the split_size of "
                f"{self.split_size:g} MB"
            )
        return self
