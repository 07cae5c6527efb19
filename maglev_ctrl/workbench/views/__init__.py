"""The views of the page; each has `root` for the page, `show(view)`, `clear(reason)`, `summary` and `figures`.

`EigenvalueView(cursor)`, `MapView(cursor)`, `LedgerView(cursor)`, `ShapeView(cursor)` share one `Cursor`;
`MarginsView()` and `ComparisonView()` stand alone (`ComparisonView.show(comparison, current)`). `figures` are what
`style.theme_switch` and `style.dress` take; `downloads.figure_files` gives each view as a file.
"""

from maglev_ctrl.workbench.views.comparison import ComparisonView
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.eigenvalues import EigenvalueView
from maglev_ctrl.workbench.views.ledger import LedgerView
from maglev_ctrl.workbench.views.map import MapView
from maglev_ctrl.workbench.views.margins import MarginsView
from maglev_ctrl.workbench.views.shape import ShapeView

__all__ = ["ComparisonView", "Cursor", "EigenvalueView", "LedgerView", "MapView", "MarginsView", "ShapeView"]
