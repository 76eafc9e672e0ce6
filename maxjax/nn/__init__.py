"""The network: an autoencoder that predicts the potential, its data, its training and its weights."""
