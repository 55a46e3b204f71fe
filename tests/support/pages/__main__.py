"""Writes the pages anew."""

from support.pages.all_pages import main

main()
