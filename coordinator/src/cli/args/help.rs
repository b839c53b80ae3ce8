//! What `render --help` says beside its flags.

pub(super) const RENDER_EXAMPLES: &str = "Examples:\n  \
    coordinator render scene.xml                            scene.png, 640x480, on this machine\n  \
    coordinator render scene.xml -o big.png --size 1920x1080 --quality draft\n  \
    coordinator render scene.xml --max-error 0.5            as good as that, no better\n  \
    coordinator render scene.xml --time-limit 90s           as good as that time allows\n  \
    coordinator render scene.xml --region 300,200,400,300   look at one part\n  \
    coordinator render scene.xml --listen 0.0.0.0:4747      on workers elsewhere, each started by\n                                                          \
    worker --connect THIS-HOST:4747\n\n\
    '--help' says more about every flag.";

pub(super) const RENDER_MORE: &str = "Examples:\n  \
    coordinator render scene.xml\n      \
        scene.png, 640x480, on this machine\n  \
    coordinator render scene.xml -o big.png --size 1920x1080 --quality draft\n      \
        a larger picture, sooner\n  \
    coordinator render scene.xml --max-error 0.5\n      \
        with a root mean squared error below half an 8-bit step, and hardly better\n  \
    coordinator render scene.xml --time-limit 90s\n      \
        the best there is in a minute and a half, reading and writing included\n  \
    coordinator render scene.xml --samples 16\n      \
        each pixel the mean of 4x4 points\n  \
    coordinator render scene.xml -o part.png --size 1920x1080 --region 900,500,1000,600\n      \
        100x100 pixels of it, the same as in the whole\n  \
    coordinator render scene.xml -o radiance.exr --report report.json\n      \
        linear floats, and what the render cost\n  \
    coordinator render scene.xml --listen 0.0.0.0:4747\n      \
        on workers elsewhere, each started by 'worker --connect THIS-HOST:4747'\n  \
    coordinator render scene.xml --listen 0.0.0.0:4747 --workers 2\n      \
        the same, and this machine helps\n\n\
    Exit codes:\n  \
    0    done\n  \
    1    the render failed\n  \
    2    the arguments make no sense, or the picture could not be written where it should\n  \
    3    the scene is not valid\n  \
    4    no worker came, or all were lost for good\n  \
    5    the accuracy asked for was not reached, for want of time or otherwise; the picture is written\n  \
    130  interrupted; what was done is kept beside the target, as NAME.partial.png\n\n\
    A first Ctrl-C stops and keeps what is done, a second one leaves at once. The same command goes on where \
    any of these ended it, or a crash, from what is kept in OUTPUT.journal.";

pub(super) const FLEET_EXAMPLES: &str = "Examples:\n  \
    coordinator fleet slurm --connect head:4747 --fleet-workers 0..64 --fleet-args '--partition=long --time=2:00:00'\n  \
    coordinator fleet slurm --connect head:4747 --fleet-workers 8 --print\n      \
        the script that sbatch would be given, and nothing else\n  \
    coordinator render scene.xml --listen 0.0.0.0:4747 --fleet slurm --fleet-workers 1..32\n      \
        workers for this picture, ended with it\n\n\
    With a range, there are as many workers as the work that is left is worth, and fewer again when there is nothing \
    to do. All are ended at the end, whatever it is; if this program itself is killed, workers leave when they have \
    had no coordinator for as long as --fleet-give-up-after says.";
