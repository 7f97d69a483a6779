"""Maximum likelihood of a linear model beside noise: spectra, noise filters, the fit."""
