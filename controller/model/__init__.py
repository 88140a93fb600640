"""Models of the car: bicycle with understeer, tyres, lags."""
