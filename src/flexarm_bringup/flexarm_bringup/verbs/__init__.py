"""What can be typed after `flexarm`; each verb only reads its arguments and calls one function."""
