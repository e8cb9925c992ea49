"""Persistency of excitation: certificates, exact orders, and the information of regressors."""
