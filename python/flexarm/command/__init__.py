"""Commands of an arm's end and joints: what to send so that it goes where it should, without ringing."""
