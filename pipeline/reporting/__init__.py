"""What is said about a result: the manifest for programs, facts and the page for people."""
