"""What the transcripts of the commands are played on."""
