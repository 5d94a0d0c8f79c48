"""The workbench: a local web page where a person steers a merge. docs/studio.md shows it.

workbench.py holds what is on the bench and does what is asked, without any web; server.py speaks to the page.
"""
