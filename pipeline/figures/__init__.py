"""The paper's figures and its table, from what the stages wrote for this project's scenes."""
