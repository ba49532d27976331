"""Services that all packages use: the store of finished work, locks of output folders, denoising."""
