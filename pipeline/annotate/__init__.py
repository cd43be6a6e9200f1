"""Annotating a photograph: the scene file as a document, its preview, and the page that shows both."""
