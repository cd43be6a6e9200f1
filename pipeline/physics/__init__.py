"""The paper's equations and the quadratures behind them; pure functions, no files."""
