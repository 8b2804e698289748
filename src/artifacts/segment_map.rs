use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::rigs::segment_map::{Segment, SegmentMap};

/// What a joint follows that follows nothing.
const NOTHING: u32 = u32::MAX;

impl Artifact for SegmentMap {
    const TYPE: ArtifactType = ArtifactType {
        name: "segment_map",
        version: 1,
        doc: "For every target joint the source joint whose bone it follows: `source_of_target` \
              (Q_target indices, 4294967295 for none), and the part of that bone, `span` \
              (Q_target x 2, in 0 to 1).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let segments = self.segments();
        let source: Vec<u32> =
            segments.iter().map(|it| it.map_or(NOTHING, |it| it.source)).collect();
        let span: Vec<f64> =
            segments.iter().flat_map(|it| it.map_or([0.0; 2], |it| [it.from, it.to])).collect();
        to.owned("source_of_target", &[source.len()], source);
        to.owned("span", &[segments.len(), 2], span);
        to.text("n_source", self.n_source().to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let n_source = from.text("n_source")?.parse();
        let n_source: usize = n_source.map_err(|_| DecodeError::new("`n_source`"))?;
        let source = from.vector::<u32>("source_of_target")?;
        let (n_spans, 2, span) = from.matrix::<f64>("span")? else {
            return Err(DecodeError::new("`span` has no two columns"));
        };
        if source.len() != n_spans {
            return Err(DecodeError(format!("{} joints, {n_spans} spans", source.len())));
        }
        let segment = |(&source, span): (&u32, &[f64])| {
            (source != NOTHING).then(|| Segment { source, from: span[0], to: span[1] })
        };
        let segments = source.iter().zip(span.chunks_exact(2)).map(segment).collect();
        Self::new(n_source, segments).map_err(|error| DecodeError(error.to_string()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        let n_mapped = self.segments().iter().flatten().count();
        vec![
            ("source joints".to_owned(), self.n_source().to_string()),
            ("target joints".to_owned(), format!("{}, {n_mapped} mapped", self.segments().len())),
        ]
    }
}
