"""The plan: how finely a fog is made, by what a person asks and what a measured model says of time and error."""
