"""The scene file as a document that a program edits and a person reads."""
