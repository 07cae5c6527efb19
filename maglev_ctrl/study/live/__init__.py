"""What the workbench page shows: one option at the values of its sliders, fast first, verified after."""

from maglev_ctrl.study.live.comparison import compare_options
from maglev_ctrl.study.live.records import (
    LiveComparison,
    LiveMap,
    LiveQuantity,
    LiveRegion,
    LiveView,
    SliderGroup,
)
from maglev_ctrl.study.live.study import LiveStudy

__all__ = [
    "LiveComparison",
    "LiveMap",
    "LiveQuantity",
    "LiveRegion",
    "LiveStudy",
    "LiveView",
    "SliderGroup",
    "compare_options",
]
