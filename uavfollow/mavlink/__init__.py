"""MAVLink: links that carry bytes, packers and a parser, and the messages built from commands."""
