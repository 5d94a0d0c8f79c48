"""The report of a merge: one HTML file, and the same pictures for papers."""

from mapmeld.report_page.page import page
from mapmeld.report_page.story import Story, retold, story_of

__all__ = ["Story", "page", "retold", "story_of"]
