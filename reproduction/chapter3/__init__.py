"""Chapter 3: models reduced by MRM, MSV and MRMC, and updated."""
