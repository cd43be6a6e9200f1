"""Camera, planes, boxes and rays in world metres; pure functions, no files."""
