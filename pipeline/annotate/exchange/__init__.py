"""Annotations drawn in other programs, into a scene file and out of it.

What a drawing stands for in the scene is said by its label, KIND:NAME, KIND:NAME:PART or either with @PLANE behind it;
`labels.py` has the list. The formats each have a file of their own and give the same `Drawings`.
"""
