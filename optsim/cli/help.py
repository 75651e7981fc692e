"""What ``optsim --help`` and ``optsim VERB --help`` say; kept apart so that help loads no stage."""

HELP = """optsim renders a spectral world with Mitsuba 3, photographs it through a double-Amici coded-aperture camera, and tells
how well a monochrome, a Bayer and a Foveon sensor let you recover it.

Each verb reads the file of the stage before and writes the next:

    optsim render color-checker --size 64 -o cube.nc
    optsim measure cube.nc --sensor foveon --shots 1 -o frames.nc
    optsim reconstruct frames.nc -o estimate.nc
    optsim score estimate.nc cube.nc

or everything at once: `optsim run --quick`. Exit code 0: done; 1: the work failed; 2: bad usage or bad input; 130: Ctrl-C.
"""

HELPS = {
    "run": """The whole study: scenes to verdict, with report.html.

Renders both targets at 256 x 256 x 24, photographs them with a monochrome, a Bayer and a Foveon sensor at R = 1/8, 1/4,
3/8 and 1/2, reconstructs and scores: under fifteen minutes on two cores. Ctrl-C keeps what is finished; the same command goes on.

Example: `optsim run --quick --out first-look`
""",
    "render": """Render a scene to a cube of spectral radiance.

W m^-2 sr^-1 nm^-1, mean over each band, with the Monte Carlo standard error beside it.

Example: `optsim render color-checker --size 256 --error 0.01 -o cube.nc`

A scene of your own is a TOML file (docs/scenes.md has a complete one): `optsim render still-life.toml -o cube.nc`

For `measure --physical`: `optsim render color-checker --subdivide 10 --oversample 2 -o fine.nc`

The scene decides which effects are modelled (`optsim explain SCENE`); `--force sky` or `--without interreflection` decides by hand.
The last line tells the error reached: RMS over the picture in the worst band, relative to the band's mean, with its 95 % interval.
""",
    "measure": """Photograph a cube through mask, prism and sensor.

Masks, shifts and responses travel in the frames file, so that it can be reconstructed from that file alone.

Example: `optsim measure cube.nc --sensor foveon --shots 1 -o frames.nc`

Example: `optsim measure fine.nc --sensor mono --shots 3 --physical --noise -o frames.nc`

Another prism, lens or pixel is a camera file in TOML (docs/files.md): `--physical --camera camera.toml`

Of the camera's effects, `--physical` models those that `--error` (0.001) requires; `--error 0` models all, `--force` and `--without`
name single ones, `optsim explain --camera` ranks them.
""",
    "reconstruct": """Recover the cube from frames, in the cube's own units; from a foreign measurement in frames-units over response.

Basis pursuit fits the frames exactly and needs no tau: the default for matched frames without noise. admm, gpsr and fista
minimise ||g - H Psi theta||^2 + tau ||theta||_1; admm with an automatic tau is the default for noisy and physical frames,
where an exact fit would amplify what H does not know.

Example: `optsim reconstruct frames.nc -o estimate.nc`

Example: `optsim reconstruct frames.nc --solver gpsr --tau 1e-4 -o estimate.nc`

Example: `optsim reconstruct frames.nc --prior quality -o estimate.nc`: beyond the paper, some dB better

Example: `optsim reconstruct noisy.nc --prior quality --weighted --tau discrepancy -o estimate.nc`

docs/solvers.md says which solver suits what.
""",
    "score": """Compare an estimate with the true cube.

PSNR (mean over bands; the peak is the truth's maximum), SSIM, spectral angle, RMSE. A truth that is finer than the
estimate, in mirrors or in bands, is averaged first.

Example: `optsim score estimate.nc cube.nc --json`
""",
    "study": """The verdict on the paper's claims, and the paper's experiment.

`paper-claims` judges every claim under readings that change one factor at a time, with 95 % intervals over scenes and masks.
`experiment` photographs toy bricks with the paper's test bed, emulated, and compares the recovered spectra with the truth.

Example: `optsim study paper-claims --quick --out verdict`
""",
    "import": """Bring in a cube as others keep them.

ENVI, MATLAB v5 to v7.3 (ICVL, ARAD, KAIST, TSA), folders of PNG (CAVE), spectral EXR, .npy, HDF5, netCDF.

The file is decoded in a child process with limits: a damaged or hostile one is refused, never run. What the file leaves open is stated.

Example: `optsim import beads_ms -o beads.nc` (a folder of the CAVE set: `..._ms_01.png` to `..._ms_31.png`)

Example: `optsim import scene01.mat --wavelengths tsa-453.5 -o scene01.nc`

Example: `optsim import cube.npy --axes wavelength,y,x --wavelengths 400:700:31 -o cube.nc`
""",
    "import-measurement": """Bring in a measurement that optsim did not make: frames, mask, and where each band falls.

Shifts are whole or broken pixels of either sign. The result is a frames file for `optsim reconstruct` (docs/measurement.md).

Example: `optsim import-measurement scene1.mat --mask mask.mat --shifts 2 --wavelengths tsa-453.5 -o frames.nc`

Example: `optsim import-measurement simulation_test.mat --scene 3 --mask mask.mat --shifts 2 --wavelengths tsa-453.5 -o frames.nc`

Example: `optsim import-measurement frame.png --mask mask.png --shifts 0,0.9,2.1 --wavelengths 500,550,610 -o frames.nc`
""",
    "export": """Write a measurement for solvers that are not optsim's.

`--layout tsa`: the MATLAB files that learned solvers of the KAIST / TSA benchmark read (mask.mat, mask_3d_shift.mat, Measurements, Truth).

Example: `optsim export frames.nc --layout tsa --truth cube.nc -o benchmark`
""",
    "prism": """Study of a camera's prism, by default of the double Amici.

Where light lands on the sensor, nm per pixel, band centres and edges, distance from the paper's table; smile over the field;
what each number of the drawing does to the curve, which numbers spots cannot tell apart, and what tolerances leave. Position 0
is the centre of the 455 nm pixel; the bands are the prism's own steps of one pixel.

Example: `optsim prism --plot prism.png`

Example: `optsim prism --camera camera.toml --at 450,520,650 --json`: chief rays, position_mm from the optical axis

Example: `optsim prism --cost nonlinearity`: also the dB that wrong beliefs about the dispersion and the mask's place cost
""",
    "calibrate": """Fit a camera's file to spots of known wavelength.

SPOTS is a CSV with columns wavelength_nm, X_mm, Y_mm (lit place at the mirrors), x_px, y_px (centroid) and, if known, sigma_px.
Without it, a camera is built at random within its tolerances and measured. The answer: the dispersion curve with its standard
error, offset, rotation and scale of the mirrors' image, their covariance, and which combinations of parameters the spots cannot
tell apart.

Example: `optsim calibrate --noise 0.1 --plot calibration.png`

Example: `optsim calibrate spots.csv --camera camera.toml -o fitted.toml`
""",
    "camera": """Print the default camera as TOML: a file to change and to pass to --camera.

Example: `optsim camera > camera.toml`
""",
    "explain": """Which physical effects a scene, or a camera, requires.

A scene's are decided from materials, geometry and lights, never from its name; with the error of leaving each out.

Example: `optsim explain color-checker --json`

A camera's are ranked by how far they move light (px), by the share of light that is wrong without them, and by what a
reconstruction loses (dB) whose H leaves them out; those that the error asked for requires are marked. `--no-db` is quick.

Example: `optsim explain --camera camera.toml --plot effects.png` (`--camera default`: the default camera)
""",
    "doctor": """Check this machine by rendering a real scene in a child process.

Backend, LLVM version, cores, memory, versions.

Example: `optsim doctor --json`
""",
    "scenes": """List what can be rendered.

Example: `optsim scenes`
""",
    "show": """Draw a cube, frames or an estimate as a PNG.

sRGB, a few bands, spectra of points.

Example: `optsim show cube.nc -o cube.png`
""",
}
