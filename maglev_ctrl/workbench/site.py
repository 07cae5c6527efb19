"""What all pages of one server share: scenarios, reports, studies ready to use, threads for small work."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from maglev_ctrl.workbench.jobs import ReportJobs
from maglev_ctrl.workbench.live_thread import Shelf
from maglev_ctrl.workbench.sources import Sources

if TYPE_CHECKING:
    from maglev_ctrl.workbench.arrangement import Arrangement
    from maglev_ctrl.workbench.page import Page


@dataclass(frozen=True, eq=False, slots=True)
class Site:
    """One server's scenarios, reports and pages; `pages` by their secret key, for what they offer to download."""

    sources: Sources
    jobs: ReportJobs
    shelf: Shelf = field(default_factory=Shelf)
    pages: dict[str, Page] = field(default_factory=dict)
    spares: list[Arrangement] = field(default_factory=list)  # made ahead: a page that opens does not wait for them
    pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(2, thread_name_prefix="small work"))
