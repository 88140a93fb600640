"""How good models of steering are: scores, baselines, uncertainty, the worst frames."""
