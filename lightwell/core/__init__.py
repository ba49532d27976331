"""What every package of lightwell uses: the store of finished work and the locks of output folders."""
