"""What is kept on disk: the folder, frames, tables of responses, and the code that they come from."""
